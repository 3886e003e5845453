"""What is done with the solver: jobs and their result folders, VTK, sweeps, convergence, running-in, waits."""
