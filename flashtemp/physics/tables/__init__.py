"""Tables of loggers and instruments: text in any dialect, LabVIEW LVM and TDMS, with columns, units and time."""
