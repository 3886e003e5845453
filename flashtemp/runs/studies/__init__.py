"""Studies of many runs: sweeps, convergence, sensitivity, running-in, waits, friction, rolling."""
