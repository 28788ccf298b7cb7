"""ROS map_server maps as scenes: a `.yaml` file and its image become walls along the edges of cells.

The image's lower left pixel is the first cell; `origin` gives its lower left corner (x, y) [m] and the yaw [rad] by
which the whole map is turned about that corner. Of a pixel of brightness v in [0, 1] the map_server makes p = 1 − v (v
with `negate`), and of p, by `mode`:

- trinary: occupied above occupied_thresh, free below free_thresh, else unknown;
- scale: as trinary, but between the thresholds the chance of being occupied grows linearly;
- raw: the pixel itself (0 to 100) is the chance in percent, larger ones are unknown; `negate` has no effect.

A chance below one half is free here. A pixel that is not opaque is unknown; alpha otherwise never counts (map_server
averages it into the brightness of a trinary map, which turns opaque grey, unknown, into free).
"""

from pathlib import Path

import numpy as np
import yaml
from PIL import Image

from mannbv import grid
from mannbv.world import cells, errors, places
from mannbv.world.errors import SceneError
from mannbv.world.world import World

MODES = ("trinary", "scale", "raw")
THRESHOLDS = {"occupied_thresh": 0.65, "free_thresh": 0.196}  # where a file gives none
MOST_PIXELS = 30_000_000


def load(path: str | Path, n_robots: int = 10) -> World:
    """The world of a ROS map, with starts and goals for `n_robots` robots, or as many as fit.

    Free are the cells of the largest connected free region; everything else is solid. Every edge between the two is a
    wall, be it occupied or just unknown beyond, so every sight line ends. Raises SceneError.
    """
    path = Path(path)
    state, resolution, origin = read(path)
    free = cells.largest(state == grid.FREE)
    if not free.any():
        raise SceneError(f"{path}: no cell is free; check negate, mode and the thresholds")
    with errors.naming(path):
        ground = cells.ground(free, resolution, origin[:2], origin[2])
        starts, goals = places.choose(ground, n_robots)
    if len(starts) == 0:
        raise SceneError(f"{path}: no free region is wide enough for a robot; check resolution and the thresholds")
    return World(path.stem, f"ROS map, {resolution:g} m a cell", ground.walls, ground, starts, goals)


def read(path: str | Path) -> tuple[np.ndarray, float, np.ndarray]:
    """State (nx, ny) of `grid.UNKNOWN`, FREE, OCCUPIED, the cell size [m], and the origin (x, y [m], yaw [rad])."""
    path = Path(path)
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or error}); check the path") from None
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise SceneError(f"{path}: not valid YAML ({' '.join(str(error).split())}); is the file complete?") from None
    if not isinstance(values, dict) or not isinstance(values.get("image"), str):
        raise SceneError(f"{path}: image is missing; a map_server file names its image, resolution and origin")
    resolution = _numbers(path, values, "resolution", (1,))[0]
    if resolution <= 0:
        raise SceneError(f"{path}: resolution must be positive [m], got {resolution:g}")
    origin = np.append(_numbers(path, values, "origin", (2, 3)), 0.0)[:3]
    occupied, free = (_numbers(path, values, key, (1,), default)[0] for key, default in THRESHOLDS.items())
    if not 0 <= free <= occupied <= 1:
        raise SceneError(f"{path}: needs 0 ≤ free_thresh ≤ occupied_thresh ≤ 1, got {free:g} and {occupied:g}")
    negate = bool(_numbers(path, values, "negate", (1,), 0)[0])
    mode = str(values.get("mode", "trinary")).lower()
    if mode not in MODES:
        raise SceneError(f"{path}: mode must be one of {', '.join(MODES)}, got {mode}")
    value, opaque = _pixels(path, path.parent / values["image"])
    chance = np.where(opaque, _chance(value, mode, negate, occupied, free), np.nan)
    state = np.where(np.isnan(chance), grid.UNKNOWN, np.where(chance < 0.5, grid.FREE, grid.OCCUPIED))
    return np.ascontiguousarray(state[::-1].T), float(resolution), origin


def _chance(value: np.ndarray, mode: str, negate: bool, occupied: float, free: float) -> np.ndarray:
    """Chance that a pixel of brightness `value` (0 … 255) is occupied, as ROS reads it; nan for unknown."""
    if mode == "raw":
        return np.where(value > 100, np.nan, value / 100)
    p = value / 255 if negate else (255 - value) / 255
    between = np.nan if mode == "trinary" else (p - free) / max(occupied - free, 1e-12)
    return np.where(p > occupied, 1.0, np.where(p < free, 0.0, between))


def _pixels(path: Path, image_path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Brightness 0 … 255 as the mean of the colour channels, and which pixels are opaque; (rows, columns)."""
    try:
        with Image.open(image_path) as image:
            if image.mode.startswith(("I", "F")):
                raise SceneError(f"{path}: {image_path.name} has more than 8 bits a channel; save it with 8 bits")
            if image.width * image.height > MOST_PIXELS:
                raise SceneError(f"{path}: {image_path.name} has more than {MOST_PIXELS:,} pixels; use a coarser map")
            pixels = np.asarray(image.convert("RGBA")).astype(float)
    except SceneError:
        raise
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        reason = getattr(error, "strerror", None) or str(error).replace(str(image_path), image_path.name)
        raise SceneError(f"{path}: image {image_path.name} cannot be read ({reason}); is it there, complete?") from None
    return pixels[..., :3].mean(-1), pixels[..., 3] == 255


def _numbers(path: Path, values: dict, key: str, counts: tuple, *default) -> np.ndarray:
    """One or more finite numbers; texts such as 5e-2, which YAML takes for no number, are read as well."""
    if key not in values and not default:
        raise SceneError(f"{path}: {key} is missing; a map_server file names its image, resolution and origin")
    value = values.get(key, *default)
    try:
        numbers = np.array([float(v) for v in (value if isinstance(value, list) else [value])])
    except (TypeError, ValueError):
        numbers = np.array([np.nan])
    if len(numbers) not in counts or not (np.abs(numbers) < 1e6).all():
        wanted = "a finite number" if counts == (1,) else "finite numbers [x, y, yaw]"
        raise SceneError(f"{path}: {key} must be {wanted}, got {value}")
    return numbers
