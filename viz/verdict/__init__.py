"""Pictures of a discovery: before and after, candidates, residuals, what heat is missing."""
