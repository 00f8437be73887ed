"""Torch as it is here: whether it is installed, its devices and their memory, and what it complains of."""

from __future__ import annotations

from importlib import import_module

from ...errors import AtcError


def require_torch(name):
    """AtcError where torch is not installed."""

    try:
        import torch  # noqa: F401
    except ImportError:
        raise AtcError(f"{name}: needs torch, which is not installed: pip install torch") from None


def require(module: str, package: str, name: str):
    """A module of a package for models in torch; AtcError where one of the two is not installed."""
    require_torch(name)
    try:
        return import_module(module)
    except ImportError:
        raise AtcError(f"{name}: needs {package}, which is not installed: pip install {package}") from None


def device_of(device, name):
    """The device of torch of this name; AtcError where there is none."""
    import torch

    try:
        found = torch.device(device)
        torch.zeros(1, device=found)
    except (RuntimeError, AssertionError, TypeError) as e:
        raise AtcError(f"{name}: torch has no device {device!r} here: {first_line(e)}") from None
    return found


def first_line(e: BaseException) -> str:
    """What an exception says, in one line."""
    lines = [line for line in str(e).splitlines() if line.strip()]
    # TorchScript puts where it happened first.
    said = lines[-1] if lines and lines[0].startswith("The following operation failed") else (lines or [""])[0]
    return f"{type(e).__name__}: {' '.join(said.split())[:300]}"


def free_memory(device) -> float:
    """Bytes that are free on a device."""
    import torch

    if device.type == "cuda":
        return float(torch.cuda.mem_get_info(device)[0])
    try:
        with open("/proc/meminfo") as f:
            for line in f:
                if line.startswith("MemAvailable:"):
                    return float(line.split()[1]) * 1024.0
    except OSError:
        pass
    return 4e9  # where nothing says
