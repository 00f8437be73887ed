"""Nonlocal advection."""
