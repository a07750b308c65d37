"""The trace codec: decoded records equal the encoded ones up to rounding, and damaged frames are rejected."""

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
from numpy.typing import NDArray

from wherry.errors import InputError
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose
from wherry.trace.codec import ANGLE_STEP, MAX_PARTICLES, POSITION_STEP, Decoder, Encoder
from wherry.trace.framing import split_frames
from wherry.trace.map_tiles import TILE, UNKNOWN_PERCENT, TileDecoder, percent_of
from wherry.trace.records import CellLayout, MapUpdate, Record, RobotSnapshot, StepTaken
from wherry_testing.runs import room, short_run, snapshot_at


def decoded(*records: Record) -> list[Record]:
    """The records, encoded and decoded."""
    encoder, decoder = Encoder(), Decoder("test")
    return [decoder.decode(encoder.encode(record), "a frame") for record in records]


def test_records_without_arrays_are_decoded_unchanged() -> None:
    plain = [
        record for record in short_run() if not isinstance(record, RobotSnapshot | MapUpdate | CellLayout | StepTaken)
    ]
    assert len(plain) > 8
    assert decoded(*plain) == plain


def test_integer_arrays_are_decoded_unchanged() -> None:
    records = [record for record in short_run() if isinstance(record, CellLayout | StepTaken)]
    for before, after in zip(records, decoded(*records), strict=True):
        for name in type(before).__slots__:
            np.testing.assert_array_equal(getattr(before, name), getattr(after, name))


coordinate = st.floats(-100.0, 100.0)


@settings(deadline=None)
@given(coordinate, coordinate, st.floats(-10.0, 10.0), st.integers(0, 2**32 - 1))
def test_snapshots_are_decoded_to_half_a_step(x: float, y: float, theta: float, seed: int) -> None:
    rng = np.random.default_rng(seed)

    def around(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
        return (np.array([x, y]) + rng.uniform(-60, 60, (count, 2))).astype(np.float32)

    particles = np.column_stack([around(20), rng.uniform(-7, 7, 20)]).astype(np.float32)
    before = RobotSnapshot(
        1.25, Pose(x, y, theta), Pose(x - 0.1, y, theta), around(9), particles, around(2), around(0), True
    )
    (after,) = decoded(before)
    assert isinstance(after, RobotSnapshot)
    assert (after.time, after.has_load) == (1.25, True)
    assert after.pose.distance_to(before.pose) < 2e-5
    tolerance = 0.5 * POSITION_STEP + 5e-5
    for name in ("points", "path", "boxes"):
        np.testing.assert_allclose(getattr(after, name), getattr(before, name), rtol=0, atol=tolerance)
    np.testing.assert_allclose(after.particles[:, :2], particles[:, :2], rtol=0, atol=tolerance)
    rotation = np.remainder(after.particles[:, 2] - particles[:, 2] + math.pi, math.tau) - math.pi
    assert np.abs(rotation).max() < 0.5 * ANGLE_STEP + 1e-5


def test_large_particle_sets_are_subsampled_evenly() -> None:
    (after,) = decoded(snapshot_at(0.0, 1.0, particles=3 * MAX_PARTICLES))
    assert isinstance(after, RobotSnapshot)
    assert len(after.particles) == MAX_PARTICLES
    np.testing.assert_allclose(after.particles[[0, -1], 1], [-0.9, -0.5], atol=0.005)


def assert_same_map(record: Record, grid: OccupancyGrid) -> None:
    """Every cell of a grid has its percent in the record's map, and no other cell is known."""
    assert isinstance(record, MapUpdate)
    expected = percent_of(grid)
    rows, columns = np.indices(grid.shape)
    centres = grid.centres(np.column_stack([rows.ravel(), columns.ravel()]))
    cells = record.grid.cells_at(centres)
    inside = record.grid.contains(cells)
    found = np.full(len(cells), UNKNOWN_PERCENT, np.uint8)
    found[inside] = percent_of(record.grid)[tuple(cells[inside].T)]
    np.testing.assert_array_equal(found, expected.ravel())
    known = np.count_nonzero(percent_of(record.grid) != UNKNOWN_PERCENT)
    assert known == np.count_nonzero(expected != UNKNOWN_PERCENT)


def random_grid(rng: np.random.Generator, height: int, width: int, origin: Pose) -> OccupancyGrid:
    probability = rng.choice(np.array([0.02, 0.3, 0.5, 0.97], np.float32), (height, width))
    return OccupancyGrid(probability, 0.05, origin)


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.lists(st.tuples(*[st.integers(-200, 200)] * 2), min_size=1, max_size=5))
def test_maps_that_grow_shrink_and_shift_are_decoded(seed: int, corners: list[tuple[int, int]]) -> None:
    rng = np.random.default_rng(seed)
    first = Pose(0.3, -0.2, 0.4)
    grids = [
        random_grid(rng, *rng.integers(1, 3 * TILE, 2), first @ Pose(0.05 * column, 0.05 * row))
        for column, row in corners
    ]
    for record, grid in zip(decoded(*(MapUpdate(0.0, grid, 0.5, 1.0) for grid in grids)), grids, strict=True):
        assert_same_map(record, grid)


def test_a_map_in_another_frame_gets_new_tiles() -> None:
    rng = np.random.default_rng(0)
    grids = [random_grid(rng, 70, 90, origin) for origin in (Pose(), Pose(0.013, 0.0), Pose(0.0, 0.0, 0.7))]
    for record, grid in zip(decoded(*(MapUpdate(0.0, grid, 0.5, 1.0) for grid in grids)), grids, strict=True):
        assert_same_map(record, grid)


def test_only_changed_tiles_are_encoded() -> None:
    encoder = Encoder()
    big = OccupancyGrid(np.full((2000, 2000), 0.02, np.float32), 0.05)
    whole = len(encoder.encode(MapUpdate(0.0, big, 0.5, 1.0)))
    changed = big.probability.copy()
    changed[500, 700] = 0.9
    one = len(encoder.encode(MapUpdate(1.0, replace(big, probability=changed), 0.5, 1.0)))
    none = len(encoder.encode(MapUpdate(2.0, replace(big, probability=changed), 0.5, 1.0)))
    assert whole > 2000 * 2000
    assert TILE**2 < one < TILE**2 + 400
    assert none < 400


def test_only_a_probability_of_exactly_one_half_is_unknown() -> None:
    grid = OccupancyGrid(np.array([[0.0, 0.5, 0.52, 1.0]], np.float32), 0.1)
    assert percent_of(grid).tolist() == [[0, UNKNOWN_PERCENT, 50, 100]]


def test_concatenated_frames_are_split_and_aligned() -> None:
    encoder = Encoder()
    frames = [encoder.encode(record) for record in short_run()]
    assert all(len(frame) % 4 == 0 for frame in frames)
    data = b"".join(frames)
    assert list(split_frames(data)) == frames
    assert list(split_frames(data[:-1])) == frames[:-1]


FRAME = Encoder().encode(snapshot_at(0.0, 1.0, particles=3))


@settings(deadline=None)
@given(st.integers(0, len(FRAME) - 1), st.integers(1, 255))
def test_a_frame_with_a_changed_byte_is_rejected(index: int, difference: int) -> None:
    damaged = bytearray(FRAME)
    damaged[index] ^= difference
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
        {"pose": [0.0, 1e10, 0.0]},
        {"time": 10**400},
        {"arrays": [["points", "|O", [1, 1]]]},
        {"arrays": [["points", "<i2", [-1, 2]]]},
        {"arrays": [["points", "<i2", [10**6, 2]]]},
        {"arrays": []},
    ],
)
def test_a_frame_with_invalid_values_is_rejected(change: dict[str, object]) -> None:
    (length,) = struct.unpack_from("<I", FRAME, 8)
    header = {**json.loads(FRAME[12 : 12 + length]), **change}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + text + FRAME[12 + length :]
    with pytest.raises(InputError, match="frame 1: is damaged"):
        Decoder("test").decode(struct.pack("<II", len(body), zlib.crc32(body)) + body, "frame 1")


def test_a_header_that_is_nested_deeply_is_rejected() -> None:
    text = b"[" * 100_000
    body = struct.pack("<I", len(text)) + text
    with pytest.raises(InputError, match="frame 1: is damaged"):
        Decoder("test").decode(struct.pack("<II", len(body), zlib.crc32(body)) + body, "frame 1")


@pytest.mark.parametrize(
    ("key", "percent", "reason"),
    [
        ((0, 0), 101, "more than 100 percent"),
        ((2**31 - 1, 2**31 - 1), 50, "cells"),
        ((2**20, 0), 50, "extends beyond"),
    ],
)
def test_maps_of_impossible_values_and_sizes_are_rejected(key: tuple[int, int], percent: int, reason: str) -> None:
    decoder = TileDecoder()
    keys = np.array([key] if reason == "extends beyond" else [(-(2**31) if key[0] else 0,) * 2, key], np.int32)
    tiles = np.full((len(keys), TILE, TILE), percent, np.uint8)
    with pytest.raises(ValueError, match=reason):
        _decoded_map(decoder, keys, tiles)


def _decoded_map(decoder: TileDecoder, keys: NDArray[np.int32], tiles: NDArray[np.uint8]) -> OccupancyGrid:
    decoder.update(1, keys, tiles)
    return decoder.grid(Pose(), 0.05)


def test_every_record_type_is_decoded() -> None:
    assert len(decoded(*short_run())) == len(short_run())
    assert room(30).occupied.any()
