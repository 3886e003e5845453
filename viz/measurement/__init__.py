"""Pictures of measured and computed images and sensor readings."""
