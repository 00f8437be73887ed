"""The public door to planning: what is asked, and what would be done about it."""

from .planning.report import Plan, Request, plan

__all__ = ["Plan", "Request", "plan"]
