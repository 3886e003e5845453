"""Pictures of friction theory: friction curves, spectrum, contact map, tread block, tyre."""
