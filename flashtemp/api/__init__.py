"""What commands and notebooks call: one function per task, each returns an object that shows itself."""
