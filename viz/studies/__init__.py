"""Pictures of studies: sweeps, sensitivity, load dependence, contact area."""
