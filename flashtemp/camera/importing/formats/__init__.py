"""What makers of infrared cameras write: one file per format, bytes in, raw frames out."""
