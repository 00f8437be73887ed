"""`atc report`: one page that holds all it shows, whatever the names in it are, and that a browser shows and prints."""

import base64
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest
from frames import argon

import atc
from atc.analysis.page import report
from atc.errors import AtcError

EVIL = '<script>alert("x")</script> & "quotes"'


class Reader(HTMLParser):
    """What is on a page: its texts, images and addresses; tags must be balanced."""

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.images, self.links, self.tags = [], [], [], [], set()
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        named = dict(attrs)
        self.links += [v for k, v in attrs if k in ("src", "href", "srcset", "data", "action")]
        if tag == "img":
            self.images.append(named)
        if tag not in ("img", "meta", "br", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture(scope="module")
def ds():
    frames = [
        argon(seed=k, temperature=90.0).replace(step=k, time=float(k), source=f"{EVIL} frame {k}") for k in range(4)
    ]
    for f in frames:
        f.masses, f.types = np.full(len(f), 39.948), np.arange(len(f)) % 2 + 1
    pot = atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4", units="metal")
    names = ["stress", "virial_stress", "smoothed_virial_stress", "density", "temperature", "velocity"]
    scene = f"# {EVIL}\n[fields]\n"
    return atc.fields(frames, pot, atc.kernel("quartic", 5.0), atc.Grid.regular(shape=(6, 6, 4)), names,
                      average=True, scene=scene)  # fmt: skip


def test_the_page_holds_all_it_shows(ds, tmp_path):
    path = report(ds, tmp_path / "a.html", title=EVIL, warned=[f"careful: {EVIL}"], units="GPa")
    text = path.read_text()
    page = Reader(text)
    words = " ".join(page.texts)
    assert "script" not in page.tags and "<script" not in text and words.count(EVIL) >= 4
    assert page.links and all(link.startswith("data:image/png;base64,") for link in page.links)
    assert not re.search(r"https?://|@import|url\(", text)
    for image in page.images:
        assert base64.b64decode(image["src"].partition(",")[2]).startswith(b"\x89PNG") and image["alt"]
    # stress, von Mises, density, temperature, velocity, profiles, comparison
    assert len(page.images) == 7
    for said in ("What was computed", "4 frames, averaged", "quartic", "Hardy against virial", "Errors", "The scene",
                 "careful:", "(GPa)", "statistical"):  # fmt: skip
        assert said in words, said
    assert f"{float(ds.stress.attrs['error_max']):.1e}" in words
    assert str(tmp_path) not in text and not list(tmp_path.glob(".*"))


def test_other_grids_and_parts(ds, tmp_path):
    f = argon(temperature=90.0)
    f.types = np.arange(len(f)) % 2 + 1
    kern = atc.kernel("quartic", 5.0)
    for grid in (atc.Grid.slab("z", 6), atc.Grid.points(np.random.default_rng(0).random((40, 3)) * 9)):
        one = atc.fields([f], None, kern, grid, ["density", "velocity", "column:vx"])
        assert len(Reader(report(one, tmp_path / "b.html").read_text()).images) >= 2
    apart = atc.fields([f], None, kern, atc.Grid.regular(shape=3), ["density"], by="type")
    words = " ".join(Reader(report(apart, tmp_path / "c.html").read_text()).texts)
    assert "Fields of 1" in words and "Fields of 2" in words
    words = " ".join(Reader(report(apart, tmp_path / "c.html", species="2").read_text()).texts)
    assert "Fields of 1" not in words and "Fields of 2" in words
    box = atc.fields([f], atc.potential("pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4", units="metal"), None, None,
                     ["virial_stress"])  # fmt: skip
    assert "no field on a grid" in report(box, tmp_path / "d.html").read_text()
    with pytest.raises(AtcError, match=r"ends in \.html"):
        report(ds, tmp_path / "a.pdf")
    with pytest.raises(AtcError, match="no directory"):
        report(ds, tmp_path / "nowhere" / "a.html")


def test_a_browser_shows_and_prints_it(ds, tmp_path):
    browser = next((b for b in ("chromium", "chromium-browser", "google-chrome") if shutil.which(b)), None)
    if browser is None:
        pytest.skip("no chromium here")
    from matplotlib.image import imread

    page = report(ds, tmp_path / "a.html")
    base = [browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]

    def shown(*options):
        return subprocess.run(
            [*base, *options, page.as_uri()], capture_output=True, text=True, timeout=240, check=False
        )

    shown("--window-size=1000,3000", f"--screenshot={tmp_path / 'a.png'}")
    picture = imread(tmp_path / "a.png")[..., :3]
    assert picture.shape[:2] == (3000, 1000)
    colourful = (picture.max(-1) - picture.min(-1) > 0.3).mean()
    assert colourful > 0.02  # maps were decoded and drawn
    dark = (picture.max(-1) < 0.4).any(axis=1).mean()
    assert dark > 0.1  # rows with text or lines
    shown(f"--print-to-pdf={tmp_path / 'a.pdf'}", "--no-pdf-header-footer")
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    dom = shown("--dump-dom").stdout
    assert "alert" in dom and "<script" not in dom
