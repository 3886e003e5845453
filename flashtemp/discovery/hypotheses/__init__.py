"""What may be missing from a case: candidate effects, discrepancy effects and free-form laws."""
