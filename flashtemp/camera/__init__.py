"""What infrared cameras write, what they would see of a run, and the recordings between the two."""
