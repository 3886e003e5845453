"""The catalogue: one physical or instrumental effect per file."""
