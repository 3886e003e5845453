"""Which hypothesis: scores by sensitivities, full fits of the best, forward selection."""
