"""Readers are tested with the compiled parser, which a process takes when it has read a little."""

import pytest

from atc.readers import _parse


@pytest.fixture(autouse=True)
def compiled_parser(monkeypatch):
    monkeypatch.setattr(_parse, "_by_python", _parse.FIRST_BY_PYTHON)
