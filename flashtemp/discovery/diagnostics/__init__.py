"""What a fit is worth: left-out data, adequacy, size of effects, and how each part is described."""
