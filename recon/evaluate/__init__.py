"""Measurements as commands: python -m recon.evaluate NAME."""
