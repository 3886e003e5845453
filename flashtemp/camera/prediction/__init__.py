"""What a camera or a sensor sees of a simulated temperature: image, optics, pose, visible wall."""
