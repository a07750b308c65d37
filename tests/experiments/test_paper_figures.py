"""The paper's figures, drawn from runs of wherry."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from wherry.experiments.paper_figures import CAPTIONS, reproduce

PARTICLE = re.compile(r'<line class="particle" x1="(\S+)" y1="(\S+)"')


@pytest.mark.slow
def test_every_figure_is_drawn_and_linked(tmp_path: Path) -> None:
    images = tmp_path / "images"
    images.mkdir()
    progress: list[tuple[int, int]] = []
    markdown = reproduce(images, lambda done, total: progress.append((done, total)))
    assert sorted(path.name for path in images.iterdir()) == sorted(CAPTIONS)
    assert all(f"(images/{name})" in markdown for name in CAPTIONS)
    assert progress == [(done, len(CAPTIONS)) for done in range(len(CAPTIONS))]
    for name in ("fig1a-taxi.png", "fig1b-world.png"):
        assert len(np.unique(np.array(Image.open(io.BytesIO((images / name).read_bytes()))))) > 10
    # The particles start all over the map and converge to one pose.
    spread = []
    for number in range(3):
        svg = (images / f"fig3-particles-{number}.svg").read_text()
        spread.append(np.array([match.groups() for match in PARTICLE.finditer(svg)], float).std(axis=0).max())
    assert spread[0] > 1.0  # m
    assert spread[2] < 0.1
    assert 'class="plan"' in (images / "fig4-map.svg").read_text()
    assert (images / "fig3-laser.svg").read_text().count('class="beam"') > 100
