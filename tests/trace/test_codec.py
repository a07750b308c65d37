"""Records as bytes: what goes in comes out, to the step; what is damaged is refused."""

from __future__ import annotations

import json
import math
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wherry.errors import InputError
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.codec import (
    ANGLE_STEP,
    MOST_PARTICLES,
    POSITION_STEP,
    TILE,
    UNKNOWN_PERCENT,
    Decoder,
    Encoder,
    percent_of,
    split,
)
from wherry.trace.records import CellsLaid, Explored, Record, Seen, Stepped
from wherry_testing.runs import room, seen, short_run


def again(*records: Record) -> list[Record]:
    """The records, encoded and decoded."""
    encoder, decoder = Encoder(), Decoder("test")
    return [decoder.decode(encoder.encode(record), "a frame") for record in records]


def test_records_without_arrays_come_out_as_they_were() -> None:
    plain = [record for record in short_run() if not isinstance(record, Seen | Explored | CellsLaid | Stepped)]
    assert len(plain) > 8
    assert again(*plain) == plain


def test_whole_numbers_come_out_as_they_were() -> None:
    before = [record for record in short_run() if isinstance(record, CellsLaid | Stepped)]
    for one, other in zip(before, again(*before), strict=True):
        for name in type(one).__slots__:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


coordinate = st.floats(-100.0, 100.0)


@settings(deadline=None)
@given(coordinate, coordinate, st.floats(-10.0, 10.0), st.integers(0, 2**32 - 1))
def test_what_is_seen_comes_out_to_half_a_step(x: float, y: float, theta: float, seed: int) -> None:
    rng = np.random.default_rng(seed)

    def around(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
        return (np.array([x, y]) + rng.uniform(-60, 60, (count, 2))).astype(np.float32)

    cloud = np.column_stack([around(20), rng.uniform(-7, 7, 20)]).astype(np.float32)
    before = Seen(1.25, Pose(x, y, theta), Pose(x - 0.1, y, theta), around(9), cloud, around(2), around(0), True)
    (after,) = again(before)
    assert isinstance(after, Seen)
    assert (after.time, after.loaded) == (1.25, True)
    assert after.pose.distance_to(before.pose) < 2e-5
    slack = 0.5 * POSITION_STEP + 5e-5
    for name in ("points", "path", "boxes"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), rtol=0, atol=slack)
    np.testing.assert_allclose(after.particles[:, :2], cloud[:, :2], rtol=0, atol=slack)
    turned = np.remainder(after.particles[:, 2] - cloud[:, 2] + math.pi, math.tau) - math.pi
    assert np.abs(turned).max() < 0.5 * ANGLE_STEP + 1e-5


def test_large_clouds_are_thinned_evenly() -> None:
    (after,) = again(seen(0.0, 1.0, particles=3 * MOST_PARTICLES))
    assert isinstance(after, Seen)
    assert len(after.particles) == MOST_PARTICLES
    np.testing.assert_allclose(after.particles[[0, -1], 1], [-0.9, -0.5], atol=0.005)


def assert_same_map(record: Record, grid: OccupancyGrid) -> None:
    """Every cell of a grid has its percent in the record's map, and no other cell is known."""
    assert isinstance(record, Explored)
    wanted = percent_of(grid)
    rows, columns = np.indices(grid.shape)
    middles = grid.centres(np.column_stack([rows.ravel(), columns.ravel()]))
    cells = record.grid.cells_at(middles)
    inside = record.grid.contains(cells)
    found = np.full(len(cells), UNKNOWN_PERCENT, np.uint8)
    found[inside] = percent_of(record.grid)[tuple(cells[inside].T)]
    np.testing.assert_array_equal(found, wanted.ravel())
    known = np.count_nonzero(percent_of(record.grid) != UNKNOWN_PERCENT)
    assert known == np.count_nonzero(wanted != UNKNOWN_PERCENT)


def random_grid(rng: np.random.Generator, height: int, width: int, origin: Pose) -> OccupancyGrid:
    probability = rng.choice(np.array([0.02, 0.3, 0.5, 0.97], np.float32), (height, width))
    return OccupancyGrid(probability, 0.05, origin)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.lists(st.tuples(*[st.integers(-200, 200)] * 2), min_size=1, max_size=5))
def test_maps_that_grow_shrink_and_shift_come_out(seed: int, corners: list[tuple[int, int]]) -> None:
    rng = np.random.default_rng(seed)
    first = Pose(0.3, -0.2, 0.4)
    grids = [
        random_grid(rng, *rng.integers(1, 3 * TILE, 2), first @ Pose(0.05 * column, 0.05 * row))
        for column, row in corners
    ]
    for record, grid in zip(again(*(Explored(0.0, grid, 0.5, 1.0) for grid in grids)), grids, strict=True):
        assert_same_map(record, grid)


def test_a_map_in_another_frame_begins_anew() -> None:
    rng = np.random.default_rng(0)
    grids = [random_grid(rng, 70, 90, origin) for origin in (Pose(), Pose(0.013, 0.0), Pose(0.0, 0.0, 0.7))]
    for record, grid in zip(again(*(Explored(0.0, grid, 0.5, 1.0) for grid in grids)), grids, strict=True):
        assert_same_map(record, grid)


def test_only_tiles_that_changed_are_told() -> None:
    encoder = Encoder()
    big = OccupancyGrid(np.full((2000, 2000), 0.02, np.float32), 0.05)
    whole = len(encoder.encode(Explored(0.0, big, 0.5, 1.0)))
    changed = big.probability.copy()
    changed[500, 700] = 0.9
    one = len(encoder.encode(Explored(1.0, replace(big, probability=changed), 0.5, 1.0)))
    none = len(encoder.encode(Explored(2.0, replace(big, probability=changed), 0.5, 1.0)))
    assert whole > 2000 * 2000
    assert TILE**2 < one < TILE**2 + 400
    assert none < 400


def test_a_nearly_certain_half_is_known_and_exactly_half_is_not() -> None:
    grid = OccupancyGrid(np.array([[0.0, 0.5, 0.52, 1.0]], np.float32), 0.1)
    assert percent_of(grid).tolist() == [[0, UNKNOWN_PERCENT, 50, 100]]


def test_frames_in_a_row_are_told_apart_and_stay_aligned() -> None:
    encoder = Encoder()
    frames = [encoder.encode(record) for record in short_run()]
    assert all(len(frame) % 4 == 0 for frame in frames)
    row = b"".join(frames)
    assert list(split(row)) == frames
    assert list(split(row[:-1])) == frames[:-1]


FRAME = Encoder().encode(seen(0.0, 1.0, particles=3))


@settings(deadline=None)
@given(st.integers(0, len(FRAME) - 1), st.integers(1, 255))
def test_a_changed_byte_is_refused(at: int, difference: int) -> None:
    damaged = bytearray(FRAME)
    damaged[at] ^= difference
    with pytest.raises(InputError, match="test: frame 7: is damaged"):
        Decoder("test").decode(bytes(damaged), "frame 7")


@pytest.mark.parametrize(
    "change",
    [
        {"type": "Bogus"},
        {"time": "soon"},
        {"time": float("nan")},
        {"pose": [0.0, 1.0]},
        {"pose": None},
        {"arrays": [["points", "|O", [1, 1]]]},
        {"arrays": [["points", "<i2", [-1, 2]]]},
        {"arrays": [["points", "<i2", [10**6, 2]]]},
        {"arrays": []},
    ],
)
def test_what_no_record_can_say_is_refused(change: dict[str, object]) -> None:
    (length,) = struct.unpack_from("<I", FRAME, 8)
    header = {**json.loads(FRAME[12 : 12 + length]), **change}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + text + FRAME[12 + length :]
    with pytest.raises(InputError, match="frame 1: is damaged"):
        Decoder("test").decode(struct.pack("<II", len(body), zlib.crc32(body)) + body, "frame 1")


def test_the_run_of_the_page_tests_is_whole() -> None:
    assert len(again(*short_run())) == len(short_run())
    assert room(30).occupied.any()
