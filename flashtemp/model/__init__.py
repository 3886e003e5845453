"""From case.toml to a Scene: the keys and their checks, the schedule, the laws that act, the numerics."""
