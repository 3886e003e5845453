"""The laboratory's page in the browser: a folder of files is its only state, and it does what a command line does."""
