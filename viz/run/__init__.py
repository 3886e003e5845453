"""Pictures and animations of one run."""
