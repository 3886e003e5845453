"""The catalogue of effects: one physical or instrumental effect per file."""
