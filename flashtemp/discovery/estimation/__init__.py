"""Estimation: nuisances in closed form, hyperparameters by evidence, physics by a trust region."""
