"""A laboratory that shares no solver, no closure and no camera arithmetic with flashtemp: truth for its tests."""
