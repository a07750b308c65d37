"""Map files: round trips, and errors that name the field."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from wherry.errors import InputError
from wherry.space.map_files import load_map, save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

GRID = OccupancyGrid(np.array([[0.0, 0.5, 1.0], [0.1, 0.9, 0.5]], np.float32), 0.05, Pose(-1.0, 2.0, 0.3))


def write(folder: Path, pixels: list[list[int]], **fields: object) -> Path:
    Image.fromarray(np.array(pixels, np.uint8)).save(folder / "map.pgm")
    whole = {"image": "map.pgm", "resolution": 0.1, "origin": [0.0, 0.0, 0.0], **fields}
    (folder / "map.yaml").write_text(yaml.safe_dump(whole))
    return folder / "map.yaml"


def test_trinary_maps_survive_a_round_trip(tmp_path: Path) -> None:
    loaded = load_map(save_map(GRID, tmp_path / "map.yaml"))
    np.testing.assert_array_equal(loaded.probability, [[0.0, 0.5, 1.0], [0.0, 1.0, 0.5]])
    assert loaded.origin == GRID.origin
    assert loaded.resolution == GRID.resolution


def test_scale_maps_survive_a_round_trip_to_a_255th(tmp_path: Path) -> None:
    loaded = load_map(save_map(GRID, tmp_path / "map.yaml", mode="scale"))
    np.testing.assert_allclose(loaded.probability, GRID.probability, atol=0.5 / 255 + 1e-6)


def test_the_image_has_the_bytes_of_map_saver(tmp_path: Path) -> None:
    save_map(GRID, tmp_path / "map.yaml")
    assert (tmp_path / "map.pgm").read_bytes() == b"P5\n3 2\n255\n" + bytes([254, 0, 205, 254, 205, 0])


def test_negate_and_thresholds_change_the_probabilities(tmp_path: Path) -> None:
    path = write(tmp_path, [[0, 100, 255]], negate=1, occupied_thresh=0.9, free_thresh=0.1)
    np.testing.assert_array_equal(load_map(path).probability, [[0.0, 0.5, 1.0]])
    path = write(tmp_path, [[0, 100, 255]], negate=0, occupied_thresh=0.5, free_thresh=0.1)
    np.testing.assert_array_equal(load_map(path).probability, [[1.0, 1.0, 0.0]])


def test_pixels_of_raw_maps_are_percentages(tmp_path: Path) -> None:
    np.testing.assert_allclose(
        load_map(write(tmp_path, [[0, 50, 100, 255]], mode="raw")).probability, [[0, 0.5, 1, 0.5]]
    )


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"resolution": 0}, "resolution"),
        ({"resolution": float("nan")}, "resolution"),
        ({"resolution": "wide"}, "resolution"),
        ({"resolution": True}, "resolution"),
        ({"origin": [0, 0]}, "origin"),
        ({"origin": [0, 0, float("inf")]}, "origin.2"),
        ({"mode": "binary"}, "mode"),
        ({"mode": "raw"}, "mode"),
        ({"negate": 2}, "negate"),
        ({"free_thresh": 0.7}, "free_thresh"),
        ({"image": 3}, "image"),
        ({"occupied_thresh": 0.1}, "free_thresh"),
    ],
)
def test_an_invalid_field_is_named(tmp_path: Path, fields: dict[str, object], field: str) -> None:
    with pytest.raises(InputError) as caught:
        load_map(write(tmp_path, [[0, 101, 254]], **fields))
    assert caught.value.field == field


@pytest.mark.parametrize("content", ["{", "- a", "", "image: !!python/object:os.system x", "\x00"])
def test_a_file_that_is_not_a_yaml_mapping_is_rejected(tmp_path: Path, content: str) -> None:
    path = tmp_path / "map.yaml"
    path.write_text(content)
    with pytest.raises(InputError):
        load_map(path)


def test_missing_and_broken_images_are_named(tmp_path: Path) -> None:
    path = write(tmp_path, [[0, 101, 254]])
    (tmp_path / "map.pgm").write_bytes(b"P5\n3 9\n255\n" + bytes(3))
    with pytest.raises(InputError, match=r"map\.pgm.*broken"):
        load_map(path)
    (tmp_path / "map.pgm").write_bytes(b"nothing")
    with pytest.raises(InputError, match="not an image"):
        load_map(path)
    (tmp_path / "map.pgm").unlink()
    with pytest.raises(InputError, match=r"map\.pgm"):
        load_map(path)


def test_an_oversized_image_is_rejected_before_its_pixels_are_decoded(tmp_path: Path) -> None:
    path = write(tmp_path, [[0, 101, 254]])
    (tmp_path / "map.pgm").write_bytes(b"P5\n100000 100000\n255\n" + bytes(3))
    with pytest.raises(InputError, match="pixels"):
        load_map(path)
