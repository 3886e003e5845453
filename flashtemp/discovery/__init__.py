"""What the model is missing, from hypothesis and prediction to search and verdict; it starts in `discover`."""
