"""Frames over processes and clusters, averages collected, the output's store."""
