"""Files of cameras and loggers turned into one recording."""
