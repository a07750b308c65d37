"""A film of a simulated run: the robot from behind on the left, the whole building on the right."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from wherry.errors import InputError
from wherry.files import partial_file
from wherry.simulation import Simulation
from wherry.simulation.rendering import SceneRenderer
from wherry.trace.records import Record, RobotSnapshot, Sink

WIDTH, HEIGHT = 640, 720  # pixels, of each of the two views
FRAME_RATE = 25  # Hz, of the film
TIME_LAPSE = 8.0  # s on the robot's clock ÷ s of film
FRAME_PERIOD = TIME_LAPSE / FRAME_RATE  # s on the robot's clock from one frame to the next


@contextmanager
def film_recording(path: Path, simulation: Simulation) -> Iterator[Sink]:
    """Yield a sink that renders the simulation at each robot snapshot into an MP4 file (H.264).

    Args:
        path: Path of the film, ending in .mp4.
        simulation: The simulation.

    Raises:
        InputError: The encoder is not installed, nothing can be rendered, or the file cannot be written.
    """
    try:
        import av  # noqa: PLC0415 - an optional dependency
    except ImportError as error:
        raise InputError("--video", "av", 'is not installed: pip install "wherry[video]"') from error
    if path.suffix != ".mp4":
        raise InputError("--video", str(path), "must end in .mp4")
    with (
        closing(SceneRenderer(simulation, WIDTH, HEIGHT)) as renderer,
        partial_file(path) as partial,
        av.open(partial, "w") as container,
    ):
        stream = container.add_stream("libx264", rate=FRAME_RATE, options={"crf": "23"})
        stream.width, stream.height, stream.pix_fmt = 2 * WIDTH, HEIGHT, "yuv420p"
        last = -1  # index of the last frame encoded

        def film(record: Record) -> None:
            nonlocal last
            if not isinstance(record, RobotSnapshot) or (index := math.floor(record.time / FRAME_PERIOD)) <= last:
                return
            picture = np.hstack([renderer.chase(), renderer.overhead()])
            for _ in range(index - last):  # the picture is repeated for the frames since the last snapshot
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
            last = index

        yield film
        container.mux(stream.encode())
