"""Temperature of the side wall that the camera looks at, from the temperatures of a two-dimensional run."""
