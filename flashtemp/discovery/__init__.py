"""What the model is missing: hypothesis, prediction, calibration, scores, search, assessment, verdict."""
