"""Map files: every mode against map_server's values, round trips, and errors that name the field."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from wherry.errors import InputError
from wherry.space.map_files import load_map, save_map
from wherry.space.occupancy import OccupancyGrid
from wherry.space.pose import Pose

GRID = OccupancyGrid(np.array([[0.0, 0.5, 1.0], [0.1, 0.9, 0.5]], np.float32), 0.05, Pose(-1.0, 2.0, 0.3))
YAML = "image: map.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\n"


def write(folder: Path, pixels: Any, *, image: str = "map.pgm", **fields: object) -> Path:
    Image.fromarray(np.array(pixels, np.uint8)).save(folder / image)
    whole = {"image": image, "resolution": 0.1, "origin": [0.0, 0.0, 0.0], **fields}
    (folder / "map.yaml").write_text(yaml.safe_dump(whole))
    return folder / "map.yaml"


def write_text(folder: Path, text: str) -> Path:
    Image.fromarray(np.array([[0, 205, 254]], np.uint8)).save(folder / "map.pgm")
    (folder / "map.yaml").write_bytes(text.encode())
    return folder / "map.yaml"


def map_server(pixel: tuple[int, ...], mode: str, *, negate: bool, occupied: float, free: float) -> float:
    """Probability of a pixel (grey, RGB or RGBA) by nav2's map_io.cpp, without its rounding to whole percents."""
    alpha = pixel[3] if len(pixel) == 4 else 255
    channels = pixel if mode == "trinary" else pixel[:3]
    shade = sum(channels) / len(channels) / 255.0
    if mode == "raw":
        return 0.5 if shade == 1.0 else shade * 2.55
    occupancy = shade if negate else 1.0 - shade
    if mode == "scale" and alpha < 255:
        return 0.5
    if occupancy > occupied:
        return 1.0
    if occupancy < free:
        return 0.0
    return 0.5 if mode == "trinary" else (occupancy - free) / (occupied - free)


def test_trinary_maps_survive_a_round_trip(tmp_path: Path) -> None:
    loaded = load_map(save_map(GRID, tmp_path / "map.yaml"))
    np.testing.assert_array_equal(loaded.probability, [[0.0, 0.5, 1.0], [0.0, 1.0, 0.5]])
    assert loaded.origin == GRID.origin
    assert loaded.resolution == GRID.resolution


def test_scale_maps_survive_a_round_trip_to_a_255th(tmp_path: Path) -> None:
    loaded = load_map(save_map(GRID, tmp_path / "map.yaml", mode="scale"))
    np.testing.assert_allclose(loaded.probability, GRID.probability, atol=0.5 / 255 + 1e-6)


def test_every_probability_survives_in_mode_scale_and_unknown_is_transparent(tmp_path: Path) -> None:
    probability = np.linspace(0.0, 1.0, 1001, dtype=np.float32).reshape(7, 143)
    loaded = load_map(save_map(OccupancyGrid(probability, 0.05), tmp_path / "map.yaml", mode="scale"))
    np.testing.assert_allclose(loaded.probability, probability, atol=0.51 / 255)
    assert (loaded.probability[probability == 0.5] == 0.5).all()
    assert (loaded.probability[[0, -1], [0, -1]] == [0.0, 1.0]).all()
    alpha = np.asarray(Image.open(tmp_path / "map.png"))[::-1, :, 3]
    np.testing.assert_array_equal(alpha == 0, probability == 0.5)


def test_the_image_has_the_bytes_of_map_saver(tmp_path: Path) -> None:
    save_map(GRID, tmp_path / "map.yaml")
    assert (tmp_path / "map.pgm").read_bytes() == b"P5\n3 2\n255\n" + bytes([254, 0, 205, 254, 205, 0])


@pytest.mark.parametrize("mode", ["trinary", "scale"])
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize(("occupied", "free"), [(0.65, 0.196), (0.65, 0.25), (0.9, 0.1), (1.0, 0.0)])
def test_every_grey_value_is_read_as_by_map_server(
    tmp_path: Path, mode: str, negate: bool, occupied: float, free: float
) -> None:
    greys = np.arange(256).reshape(1, 256)
    path = write(tmp_path, greys, mode=mode, negate=int(negate), occupied_thresh=occupied, free_thresh=free)
    thresholds = {"negate": negate, "occupied": occupied, "free": free}
    expected = [[map_server((grey,), mode, **thresholds) for grey in range(256)]]
    np.testing.assert_allclose(load_map(path).probability, expected, atol=1e-6)


@pytest.mark.parametrize("mode", ["trinary", "scale"])
@pytest.mark.parametrize("channels", [3, 4])
def test_the_channels_of_colours_are_averaged(tmp_path: Path, mode: str, channels: int) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, channels), np.uint8)
    pixels[:10, ..., 3:] = 255
    path = write(tmp_path, pixels, image="map.png", mode=mode)
    expected = [
        [map_server(tuple(map(int, pixel)), mode, negate=False, occupied=0.65, free=0.196) for pixel in row]
        for row in pixels[::-1]
    ]
    np.testing.assert_allclose(load_map(path).probability, expected, atol=1e-6)


def test_known_colours_and_transparent_pixels(tmp_path: Path) -> None:
    red, green, clear, faint = (255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 0, 0), (0, 0, 0, 254)
    white, black = (255, 255, 255, 255), (0, 0, 0, 255)
    pixels = [[red, green, clear, faint, white, black]]
    scale = load_map(write(tmp_path, pixels, image="map.png", mode="scale"))
    # red and green have grey value 85, so both are 2/3 occupied, which is above the threshold; luma would differ
    np.testing.assert_array_equal(scale.probability, [[1.0, 1.0, 0.5, 0.5, 0.0, 1.0]])
    trinary = load_map(write(tmp_path, pixels, image="map.png"))
    # with alpha as a fourth channel, red has grey value 127.5, opaque black 63.75
    np.testing.assert_array_equal(trinary.probability, [[0.5, 0.5, 1.0, 1.0, 0.0, 1.0]])


def test_pixels_of_raw_maps_are_percentages(tmp_path: Path) -> None:
    np.testing.assert_allclose(
        load_map(write(tmp_path, [[0, 50, 100, 255]], mode="raw")).probability, [[0, 0.5, 1, 0.5]]
    )
    colours = [[(3, 3, 3), (1, 2, 4), (255, 255, 255)]]
    found = load_map(write(tmp_path, colours, image="map.png", mode="raw")).probability
    np.testing.assert_allclose(found, [[0.03, 7.0 / 300.0, 0.5]], rtol=1e-6)


def stored(folder: Path, how: str) -> str:
    """The greys 0, 205 and 254, or black and white, stored in some way; the file's name."""
    grey = Image.fromarray(np.array([[0, 205, 254]], np.uint8))
    name = f"map.{'pgm' if how.startswith(('pgm', 'pbm')) else how.partition('-')[0]}"
    path = folder / name
    match how:
        case "png-palette":
            grey.convert("P").save(path)
        case "png-16":
            Image.fromarray(np.array([[0, 205, 254]], np.uint16) * 257).save(path)
        case "png-la":
            grey.convert("LA").save(path)
        case "pgm-16":
            path.write_bytes(b"P5 3 1 65535\n" + (np.array([0, 205, 254]) * 257).astype(">u2").tobytes())
        case "pgm-100":
            path.write_bytes(b"P5\n# CREATOR: map_saver\n3 1\n# maxval\n100\n" + bytes([0, 80, 100]))
        case "pgm-plain":
            path.write_text("P2\n# plain\n3 1 255\n0 205 254\n")
        case "pbm":
            path.write_bytes(b"P4\n3 1\n" + bytes([0b10000000]))
        case _:
            grey.save(path)
    return name


@pytest.mark.parametrize(
    ("how", "expected"),
    [
        *[(how, [1.0, 0.5, 0.0]) for how in ("bmp", "png", "tiff", "png-palette", "png-16", "pgm-16", "pgm-plain")],
        ("png-la", [1.0, 0.0, 0.0]),  # alpha is averaged in: (3 · 205 + 255) / 4 is white enough to be free
        ("pgm-100", [1.0, 0.5, 0.0]),  # 80 of 100 is 204 of 255
        ("pbm", [1.0, 0.0, 0.0]),  # a set bit is black
    ],
)
def test_images_of_every_kind(tmp_path: Path, how: str, expected: list[float]) -> None:
    (tmp_path / "map.yaml").write_text(YAML.replace("map.pgm", stored(tmp_path, how)))
    np.testing.assert_array_equal(load_map(tmp_path / "map.yaml").probability, [expected])


def test_a_transparent_colour_of_a_palette_is_unknown_in_mode_scale(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[0, 100, 255]], np.uint8)).convert("P")
    image.save(tmp_path / "map.png", transparency=0)
    (tmp_path / "map.yaml").write_text(YAML.replace("map.pgm", "map.png") + "mode: scale\n")
    probability = load_map(tmp_path / "map.yaml").probability
    np.testing.assert_allclose(probability, [[0.5, (155 / 255 - 0.196) / 0.454, 0.0]], rtol=1e-6)


def test_an_absolute_path_of_the_image_is_used(tmp_path: Path) -> None:
    (tmp_path / "images").mkdir()
    save_map(GRID, tmp_path / "images" / "map.yaml")
    path = tmp_path / "map.yaml"
    path.write_text(YAML.replace("map.pgm", str(tmp_path / "images" / "map.pgm")))
    assert load_map(path).shape == (2, 3)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("trinary: false", "scale"),
        ("trinary: 'no'", "scale"),
        ("trinary: true", "trinary"),
        ("mode: Scale", "scale"),
        ("mode: TRINARY", "trinary"),
        ("mode: scale\ntrinary: false", "scale"),
        ("", "trinary"),
    ],
)
def test_the_mode_is_read_from_both_fields_and_in_any_case(tmp_path: Path, line: str, expected: str) -> None:
    found = load_map(write_text(tmp_path, f"{YAML}{line}\n")).probability[0, 1]
    assert found == pytest.approx(0.5 if expected == "trinary" else (50 / 255 - 0.196) / 0.454, abs=1e-6)


@pytest.mark.parametrize(
    "text",
    [
        'image: "map.pgm"\nresolution: "0.05"\norigin: ["-1.0", 2, .5]\nnegate: "0"\noccupied_thresh: 65e-2\n',
        "image: map.pgm\nresolution:\t5e-2\t# m\norigin:\n-\t-1\n- 2.\n- +.05E1\nnegate: false\n",
        "%YAML:1.0\n---\nimage: map.pgm\r\nresolution: 5.0e-02\r\norigin: [-1e+0, 2, 0.5]\r\nnegate: no\r\n",
        "\ufeffimage: map.pgm\nresolution: !!float 0.05\norigin: [-1.00, 2.00, 0.50]\nfree_thresh: '0.196'\n",
    ],
)
def test_numbers_are_read_as_by_map_server(tmp_path: Path, text: str) -> None:
    grid = load_map(write_text(tmp_path, text))
    assert grid.resolution == 0.05
    assert grid.origin == Pose(-1.0, 2.0, 0.5)
    np.testing.assert_array_equal(grid.probability, [[1.0, 0.5, 0.0]])


def test_thresholds_may_be_equal_in_mode_trinary_only(tmp_path: Path) -> None:
    fields = {"occupied_thresh": 0.5, "free_thresh": 0.5}
    np.testing.assert_array_equal(load_map(write(tmp_path, [[127, 128]], **fields)).probability, [[1.0, 0.0]])
    with pytest.raises(InputError, match=r"free_thresh: is 0\.5, not below occupied_thresh, which is 0\.5"):
        load_map(write(tmp_path, [[127, 128]], mode="scale", **fields))


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"resolution": 0}, "resolution"),
        ({"resolution": -0.05}, "resolution"),
        ({"resolution": 1e300}, "resolution"),
        ({"resolution": float("nan")}, "resolution"),
        ({"resolution": "wide"}, "resolution"),
        ({"resolution": "yes"}, "resolution"),
        ({"resolution": True}, "resolution"),
        ({"origin": [0, 0]}, "origin"),
        ({"origin": [0, 0, 0, 0]}, "origin"),
        ({"origin": 0}, "origin"),
        ({"origin": [0, 1e300, 0]}, "origin.1"),
        ({"origin": [0, "north", 0]}, "origin.1"),
        ({"origin": [0, 0, float("inf")]}, "origin.2"),
        ({"origin": [0, 0, 90]}, "origin"),
        ({"mode": "binary"}, "mode"),
        ({"mode": "raw"}, "mode"),
        ({"mode": 1}, "mode"),
        ({"mode": "trinary", "trinary": False}, "mode"),
        ({"mode": "scale", "trinary": True}, "mode"),
        ({"trinary": "perhaps"}, "trinary"),
        ({"negate": 2}, "negate"),
        ({"negate": "black"}, "negate"),
        ({"negate": 1, "mode": "raw"}, "negate"),
        ({"free_thresh": 0.7}, "free_thresh"),
        ({"free_thresh": -0.1}, "free_thresh"),
        ({"occupied_thresh": 65}, "occupied_thresh"),
        ({"occupied_thresh": 0.1}, "free_thresh"),
        ({"image": 3}, "image"),
        ({"image": ""}, "image"),
        ({"image": None}, "image"),
        ({"image": "map\0.pgm"}, "image"),
        ({"image": "missing.pgm"}, "image"),
        ({"image": "."}, "image"),
    ],
)
def test_an_invalid_field_is_named(tmp_path: Path, fields: dict[str, object], field: str) -> None:
    path = write(tmp_path, [[0, 101, 254]])
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **fields}))
    with pytest.raises(InputError) as caught:
        load_map(path)
    assert caught.value.field == field
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("field", ["image", "resolution", "origin"])
def test_a_missing_field_is_named(tmp_path: Path, field: str) -> None:
    lines = [line for line in YAML.splitlines() if not line.startswith(field)]
    with pytest.raises(InputError, match=f"map.yaml: {field}: is missing"):
        load_map(write_text(tmp_path, "\n".join(lines)))


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
    with pytest.raises(InputError, match=r"map\.yaml: image: .*map\.pgm: No such file or directory$"):
        load_map(path)
    os.mkfifo(tmp_path / "map.pgm")
    with pytest.raises(InputError, match=r"map\.yaml: image: .*map\.pgm: is not a file$"):
        load_map(path)


def test_an_image_in_place_of_its_description_is_refused(tmp_path: Path) -> None:
    write(tmp_path, [[0, 255]])
    with pytest.raises(InputError, match=r"map.pgm: is an image: a map is read from the YAML file"):
        load_map(tmp_path / "map.pgm")


@pytest.mark.parametrize("size", ["100000 100000", "1 1000000000", "-3 4", "0 4"])
def test_an_image_of_impossible_size_is_rejected_before_its_pixels_are_decoded(tmp_path: Path, size: str) -> None:
    path = write(tmp_path, [[0, 101, 254]])
    (tmp_path / "map.pgm").write_bytes(f"P5\n{size}\n255\n".encode() + bytes(3))
    with pytest.raises(InputError, match=r"map\.pgm"):
        load_map(path)


def test_an_oversized_image_is_rejected_before_its_pixels_are_decoded(tmp_path: Path) -> None:
    path = write(tmp_path, [[0, 101, 254]])
    (tmp_path / "map.pgm").write_bytes(b"P5\n100000 100000\n255\n" + bytes(3))
    with pytest.raises(InputError, match="pixels"):
        load_map(path)


def test_a_map_of_impossible_extent_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"map\.yaml: resolution: 100 m gives a map of 30,000 m, more than 20,000 m"):
        load_map(write(tmp_path, np.zeros((1, 300)), resolution=100))


@pytest.mark.parametrize("pixels", [np.array([[-1, 5]], np.int32), np.array([[0.5, 0.25]], np.float32)])
def test_pixels_that_map_server_does_not_read_are_refused(tmp_path: Path, pixels: Any) -> None:
    Image.fromarray(pixels).save(tmp_path / "map.tiff")
    (tmp_path / "map.yaml").write_text(YAML.replace("map.pgm", "map.tiff"))
    with pytest.raises(InputError, match=r"map\.tiff: has pixels of"):
        load_map(tmp_path / "map.yaml")


def test_the_yaw_of_the_origin_turns_the_map(tmp_path: Path) -> None:
    grid = load_map(write(tmp_path, [[0, 254]], origin=[1.0, 2.0, math.pi / 2]))
    np.testing.assert_allclose(grid.occupied_points(), [[0.95, 2.05]], atol=1e-9)


def test_a_large_image_is_read_in_blocks(tmp_path: Path) -> None:
    pixels = np.zeros((3000, 3000), np.uint8)
    pixels[2, 1500], pixels[2999, 0] = 254, 254
    free = np.argwhere(load_map(write(tmp_path, pixels)).free)
    np.testing.assert_array_equal(free, [[0, 0], [2997, 1500]])
