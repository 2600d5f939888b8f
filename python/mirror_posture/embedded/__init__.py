"""The embedded robot: a 255 mm class humanoid of 20 joints, its head camera and its session template, as package data."""
