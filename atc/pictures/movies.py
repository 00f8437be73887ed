"""Pictures one after another: animated GIF by pillow, MP4 by ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
from PIL import Image

from ..errors import AtcError
from ..running.whole import replacing
from .drawing import STYLE, fitted

#: Pictures a second, and dots an inch.
RATE, DPI = 5.0, 100


def movie_path(path) -> Path:
    """The path, if a movie can be written there; AtcError if none can."""
    path = Path(path)
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise AtcError(f"{path}: a movie's name must end in .gif or .mp4 (for ParaView: atc export)")
    if not path.parent.is_dir():
        raise AtcError(f"{path}: there is no directory {path.parent}")
    if path.suffix.lower() == ".mp4":
        _ffmpeg(path)
    return path


def write_movie(path, figures, rate: float = RATE) -> Path:
    """Figures as a movie, all of the size of the first; written whole or not at all.

    Parameters
    ----------
    path : .gif or .mp4. figures : matplotlib figures, drawn one by one. rate : how many a second

    Raises
    ------
    AtcError where it cannot be written.
    """
    import matplotlib as mpl

    path = movie_path(path)
    if not 0.1 <= rate <= 100:
        raise AtcError(f"{path}: {rate:g} pictures a second: expected 0.1 to 100")
    pages, size = [], None
    with mpl.rc_context(STYLE):
        for fig in figures:
            if size is None:
                size = fitted(fig).get_size_inches()
            fig.set_size_inches(*size)
            fig.set_dpi(DPI)
            fig.canvas.draw()
            pages.append(np.asarray(fig.canvas.buffer_rgba())[..., :3].copy())
    with replacing(path) as part:
        (_write_gif if path.suffix.lower() == ".gif" else _write_mp4)(part, pages, rate)
    return path


def _write_gif(path, pages, rate):

    first, *others = [Image.fromarray(page) for page in pages]
    first.save(path, save_all=True, append_images=others, duration=round(1000 / rate), loop=0)


def _write_mp4(path, pages, rate):
    height, width = pages[0].shape[:2]
    command = [_ffmpeg(path), "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
               "-s", f"{width}x{height}", "-r", f"{rate:g}", "-i", "-",
               "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p", str(path)]  # fmt: skip
    done = subprocess.run(command, input=b"".join(p.tobytes() for p in pages), capture_output=True, check=False)
    if done.returncode:
        raise AtcError(f"{path}: ffmpeg could not write it: {done.stderr.decode(errors='replace').strip()[:200]}")


def _ffmpeg(path) -> str:
    found = shutil.which("ffmpeg")
    if found is None:
        try:
            from imageio_ffmpeg import get_ffmpeg_exe

            found = get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            raise AtcError(
                f"{path}: an .mp4 needs ffmpeg, which is not here: install it (or pip install imageio-ffmpeg), or name "
                "the movie .gif"
            ) from None
    return found
