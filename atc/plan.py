"""The public door to planning: what is asked, and what would be done about it."""

from .planning.job import prepare
from .planning.report import Plan, plan
from .planning.request import Request

__all__ = ["Plan", "Request", "plan", "prepare"]
