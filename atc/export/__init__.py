"""Outputs for other programs."""
