"""Recordings made with the option ``--record``."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from wherry.commands.recording import recorded
from wherry.floorplan.world_files import find_world
from wherry.robot import Scan
from wherry.ros.bags.reading import read_bag
from wherry.simulation import build


def test_a_terminated_recording_is_a_complete_bag(tmp_path: Path) -> None:
    robot = build(find_world("taxi"), np.random.default_rng(0)).robot
    before = signal.getsignal(signal.SIGTERM)
    scans = 0
    with pytest.raises(KeyboardInterrupt), recorded(tmp_path / "run.bag") as (_, recorded_robot):  # noqa: PT012
        recording_robot = recorded_robot(robot)
        while scans < 10:
            scans += isinstance(recording_robot.receive(), Scan)
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(10.0)
    assert len(read_bag(tmp_path / "run.bag").scans) == 10
    assert signal.getsignal(signal.SIGTERM) is before
