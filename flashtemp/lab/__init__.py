"""The web app: pages in the browser for a folder of files.  Every action has an equivalent command line."""
