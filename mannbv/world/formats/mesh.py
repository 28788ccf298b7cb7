"""Meshes as scenes: `.glb`, `.gltf`, `.obj`, `.ply` and `.stl` files become textured triangles, upright and in metres.

Which axis is up, the unit and the storeys are read off the geometry, and can be overruled. Nothing in a file is
executed, and nothing is read but the file and what lies in its folder.
"""

import io
import json
import logging
import math
import struct
import warnings
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import trimesh
from PIL import Image
from trimesh.resolvers import FilePathResolver
from trimesh.visual.material import PBRMaterial

from mannbv.world import errors, places
from mannbv.world.errors import SceneError
from mannbv.world.formats import storeys, upright
from mannbv.world.surfaces import Surfaces
from mannbv.world.world import World

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
GREY = 0.7  # colour of what has none
MOST_BYTES, MOST_FACES = 2**30, 10_000_000
_COMPRESSED = ("draco", "meshopt", "quantization")
logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else its warnings reach the screen


def load(
    path: str | Path, up: str | None = None, scale: float | None = None, floor: float | None = None, n_robots: int = 10
) -> World:
    """The scene of a mesh, on the storey nearest to the height `floor` [m], or on that with the most free ground.

    up, scale: as in `read`. Raises SceneError.
    """
    path = Path(path)
    surfaces, notes = read(path, up, scale)
    heights = storeys.floors(surfaces)
    if not heights:
        low, high = surfaces.lower[2], surfaces.upper[2]
        guess = 100 if high - low < 1 else 0.01
        raise SceneError(
            f"{path}: no floor found between z = {low:.2f} and {high:.2f} m; is the unit metres, and which axis is up? "
            f"Try --scale {guess:g}, or --up"
        )
    with errors.naming(path):
        here = _storey(surfaces, heights, floor)
        ground = storeys.ground(surfaces, here)
        starts, goals = places.choose(ground, n_robots)
    if len(starts) == 0:
        raise SceneError(
            f"{path}: no robot fits on the floor at {here:.2f} m; is the unit metres? Try --scale, or --floor"
        )
    if len(heights) > 1:
        listed = ", ".join(f"{z:.2f}" for z in heights)
        notes += (f"floors at z = {listed} m; this one is {here:.2f} m, --floor chooses another",)
    description = f"mesh of {len(surfaces.corners):,} triangles, {here:.2f} m floor"
    return World(path.stem, description, surfaces, ground, ground.raised(starts), ground.raised(goals), notes)


def _storey(surfaces: Surfaces, heights: list[float], wanted) -> float:
    """The floor nearest to a height [m], or the one with the most free ground."""
    if wanted is not None:
        return storeys.nearest(heights, wanted)
    if len(heights) == 1:
        return heights[0]
    return max(heights, key=lambda z: storeys.free_cells(surfaces, z)[1].sum())


def read(path: str | Path, up: str | None = None, scale: float | None = None) -> tuple[Surfaces, tuple[str, ...]]:
    """The surfaces of a mesh, z up and in metres, and a line about each thing that was guessed or left out.

    up: the file's axis that points up, a key of `upright.UP`. scale: metres a unit. Raises SceneError.
    """
    path = Path(path)
    if up is not None and up not in upright.UP:
        raise SceneError(f"{path}: up must be one of {', '.join(upright.UP)}, got {up}")
    if scale is not None and not 0 < scale < math.inf:
        raise SceneError(f"{path}: scale must be a positive number of metres a unit, got {scale}")
    raw, notes = _surfaces(path)
    raw, cut = upright.without_strays(raw)
    notes += [cut] if cut else []
    axis = up or upright.up(raw)
    turned = upright.moved(raw, np.array(upright.UP[axis], float), 1.0)
    factor, why = (float(scale), f"{scale:g} m a unit") if scale else upright.unit(storeys.height(turned))
    guessed = [option for option, given in (("--up", up), ("--scale", scale)) if given is None]
    overrule = f"; {' and '.join(guessed)} would overrule" if guessed else ""
    surfaces = turned if factor == 1 else upright.moved(turned, np.eye(3), factor)
    return surfaces, (f"{axis} is up, {why}{overrule}", *notes)


# ---- what a file holds ---------------------------------------------------------------------------------------------


class _Files(FilePathResolver):
    """The files beside a mesh, none outside its folder; keeps a list of those that could not be had."""

    def __init__(self, path: Path):
        super().__init__(str(path))
        self.missing = []

    def get(self, name: str) -> bytes:
        for candidate in (unquote(name).replace("\\", "/"), Path(name.replace("\\", "/")).name):
            try:
                file = self.absolute(candidate)  # refuses what lies outside
                if file.is_file() and file.stat().st_size <= MOST_BYTES:
                    return self._checked(file)
            except (OSError, ValueError, SyntaxError, Image.DecompressionBombError):  # what Pillow raises, too
                continue
        self.missing.append(_line(name))
        raise FileNotFoundError(name)

    @staticmethod
    def _checked(file: Path) -> bytes:
        """Its content; raises for a picture that Pillow cannot open, of which trimesh would say nothing."""
        data = file.read_bytes()
        if file.suffix.lower() in (".png", ".jpg", ".jpeg", ".webp", ".tga", ".bmp", ".ktx2", ".basis", ".dds"):
            Image.open(io.BytesIO(data))
        return data


def _scene(path: Path) -> tuple[trimesh.Scene, list[str]]:
    """trimesh's reading of a file, and notes about what it leaves out."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise SceneError(f"{path}: not a mesh; give one of {', '.join(SUFFIXES)}")
    try:
        if path.stat().st_size > MOST_BYTES:
            raise SceneError(f"{path}: larger than {MOST_BYTES >> 30} GB; simplify the mesh first")
        data = path.read_bytes()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror or error}); check the path") from None
    files, notes = _Files(path), []
    try:
        if suffix in (".glb", ".gltf"):
            notes = _checked_gltf(path, _gltf(data, suffix))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = trimesh.load_scene(io.BytesIO(data), suffix[1:], files, process=False)
    except SceneError:
        raise
    except Exception as error:  # whatever trimesh trips over in a broken file
        if files.missing:
            raise SceneError(f"{path}: {files.missing[0]} is not beside it; put it there, or export a .glb") from None
        reason = f" ({_line(error)})" if isinstance(error, ValueError | NotImplementedError) and str(error) else ""
        raise SceneError(f"{path}: not a complete {suffix} file{reason}; export or download it again") from None
    absent = [f"{name} is not beside the mesh, or no picture: plain colour" for name in dict.fromkeys(files.missing)]
    return scene, notes + absent


def _line(text) -> str:
    """What others wrote, or raised, as a piece of one line."""
    text = "".join(c if c.isprintable() else " " for c in str(text)[:200])
    text = " ".join(text.split())
    return text if len(text) <= 80 else text[:79] + "…"


def _gltf(data: bytes, suffix: str) -> dict:
    """The JSON part of a glTF file."""
    if suffix == ".glb":
        magic, _, _, length, _ = struct.unpack_from("<4s4I", data)
        if magic != b"glTF":
            raise ValueError("it does not begin with glTF")
        data = data[20 : 20 + length]
    document = json.loads(data)
    if not isinstance(document, dict):
        raise ValueError("no JSON object")
    return document


def _checked_gltf(path: Path, document: dict) -> list[str]:
    """Notes about what trimesh will leave out; raises for what it would misread, and for counts no file can hold."""
    for extension in document.get("extensionsRequired", []):
        if any(word in str(extension) for word in _COMPRESSED):
            raise SceneError(f"{path}: compressed with {_line(extension)}; export it again without compression")
    for accessor in document.get("accessors", []):
        if not 0 <= accessor["count"] <= 3 * MOST_FACES:
            raise ValueError(f"an accessor of {accessor['count']} items")
    kinds = {str(image.get("mimeType", "image/png")) for image in document.get("images", [])}
    unread = sorted(kinds - {"image/png", "image/jpeg", "image/webp"})
    notes = [f"its {_line(kind)} textures cannot be read: plain colour, unless stored as PNG" for kind in unread]
    if "KHR_texture_transform" in document.get("extensionsUsed", []):
        notes.append("its texture transforms are not applied: some patterns may be shifted")
    return notes


def _surfaces(path: Path) -> tuple[Surfaces, list[str]]:
    """All triangles of a file as they stand in it, and notes."""
    scene, notes = _scene(path)
    album = _Album()
    try:
        parts = list(_parts(scene, album))
    except (ValueError, IndexError, KeyError, TypeError, MemoryError) as error:
        raise SceneError(f"{path}: its triangles cannot be read ({_line(error)}); export it again") from None
    if not parts:
        raise SceneError(f"{path}: holds no triangles; give the whole mesh of a building, no cloud of points")
    corners, colors, uv, image = (np.concatenate([part[k] for part in parts]) for k in range(4))
    keep = np.all(np.abs(corners) < 1e9, axis=(1, 2))  # neither nan nor absurd
    keep[keep] = _areas(corners[keep]) > 0
    if not keep.any():
        raise SceneError(f"{path}: none of its triangles has an area; export it again")
    return Surfaces(corners[keep], colors[keep], uv[keep], image[keep], tuple(album.images)), notes + album.notes


def _areas(corners: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


def _parts(scene: trimesh.Scene, album: "_Album"):
    """(corners, colors, uv, image) of every placed mesh."""
    placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed = [(matrix, scene.geometry[name]) for matrix, name in placed]
    placed = [(matrix, mesh) for matrix, mesh in placed if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    if sum(len(mesh.faces) for _, mesh in placed) > MOST_FACES:
        raise ValueError(f"more than {MOST_FACES:,} triangles")
    for matrix, mesh in placed:
        faces = np.asarray(mesh.faces)
        if faces.min() < 0 or faces.max() >= len(mesh.vertices):
            raise ValueError("a triangle names a corner that does not exist")
        vertices = np.asarray(mesh.vertices, float) @ matrix[:3, :3].T + matrix[:3, 3]
        yield vertices[faces], *album.painted(mesh.visual, faces)


class _Album:
    """The images of a file, each once, and notes about those that cannot be read."""

    def __init__(self):
        self.images, self.notes, self._known = [], [], {}

    def painted(self, visual, faces) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Colours (f, 3, 3), places in the image (f, 3, 2) and image (f,) of a mesh's triangles."""
        colors = np.full((len(faces), 3, 3), GREY, np.float32)
        uv, image = np.zeros((len(faces), 3, 2), np.float32), np.full(len(faces), -1, np.int32)
        material = getattr(visual, "material", None)
        if material is None:
            if visual.kind == "vertex":
                colors = _unit_range(visual.vertex_colors)[faces]
            elif visual.kind == "face":
                colors = np.repeat(_unit_range(visual.face_colors)[:, None], 3, 1)
            return colors, uv, image
        pbr = isinstance(material, PBRMaterial)
        picture = getattr(material, "baseColorTexture" if pbr else "image", None)
        if pbr:
            factor = material.baseColorFactor
            colors[:] = 1.0 if factor is None else _unit_range(factor)
        elif picture is not None:
            colors[:] = 1.0  # writers leave Kd at any value beside a texture
        elif "kd" in material.kwargs:
            colors[:] = _unit_range(material.diffuse)
        painted = visual.vertex_attributes.get("color")
        if painted is not None:
            colors = colors * _unit_range(painted)[faces]
        index = self._index(picture)
        if index >= 0 and visual.uv is not None and len(visual.uv) > faces.max():
            uv = np.nan_to_num(np.asarray(visual.uv, np.float32)[:, :2])[faces]
            image[:] = index
        return colors, uv, image

    def _index(self, picture) -> int:
        """Its place among the images; −1 for none, or one that cannot be read."""
        if picture is None:
            return -1
        if id(picture) not in self._known:
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    pixels = np.asarray(picture.convert("RGB"))
                self._known[id(picture)] = len(self.images)
                self.images.append(pixels)
            except Exception as error:  # Pillow raises many kinds for broken images
                self._known[id(picture)] = -1
                self.notes.append(f"a texture cannot be read ({_line(error)}): plain colour")
        return self._known[id(picture)]


def _unit_range(colors) -> np.ndarray:
    """Red, green, blue (…, 3) in [0, 1], whatever numbers they were stored as."""
    colors = np.asarray(colors)
    most = np.iinfo(colors.dtype).max if colors.dtype.kind == "u" else 1
    return np.clip(np.nan_to_num(colors[..., :3].astype(np.float32) / most), 0, 1)
