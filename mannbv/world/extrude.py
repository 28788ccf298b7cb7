"""Floor plans raised to furnished, textured buildings in 3-D, and a way to take those elsewhere."""

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import mapbox_earcut
import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from mannbv.kernels.flat import rays
from mannbv.world import bodies, errors, faces
from mannbv.world.formats import plan as plans
from mannbv.world.formats.plan import Block, Plan, Texture
from mannbv.world.ground import BODY
from mannbv.world.surfaces import Surfaces
from mannbv.world.world import World

TEXEL, MOST_TEXELS = 0.02, 1024  # [m] between two texels; images have at most so many a side, further apart if need be
CUT = 0.5  # [m] at this height the textures are flatland's
FADE, CALM = 1.0, 0.3  # [m], 1: noise keeps this share of its hue from so far above the cut
CEILING, PLASTER = (0.94, 0.93, 0.90), Texture("noise", 1.3, 0.06)
SKIRTING = 0.09  # [m] its height
BOARD = (1.3, 0.22)  # [m] length and width of a floor's boards
GRAIN = 0.10  # boards are lighter or darker than the floor's colour by this share
TOP, UNDERSIDE = 1.1, 0.8  # light on what faces up and down, so that edges show; upright faces keep flatland's
MARGIN = 4  # texels around each image of an exported file
_CLOSE = 1e-6  # [m] heights nearer than this are one


def load(path: str | Path) -> World:
    """The 3-D world of a plan file, with flatland's starts and goals at camera height. Raises SceneError."""
    plan = plans.read(path)
    with errors.naming(path):
        ground = plans.ground(plan, BODY)
    places = ground.raised(plan.starts), ground.raised(plan.goals)
    return World(plan.name, plan.description, surfaces(plan), ground, *places)


def surfaces(plan: Plan) -> Surfaces:
    """All that one can see inside the building of a plan: walls, furniture, a floor and a ceiling a room.

    Every flat piece has an image of its own, texels `TEXEL` [m] apart, whose outermost texels lie on the piece's
    edges. Upright faces have flatland's colours at the height `CUT`. What stands higher than the plan's walls
    ends at the ceiling.
    """
    blocks = [b for b in (*plan.walls, *plan.furniture) if b.height > _CLOSE and b.elevation < plan.wall_height]
    rooms = plan.inside
    patches = [*_upright(plan, blocks, rooms), *_flat(plan, blocks, rooms), *_floors(plan, rooms)]
    triangles, uv, images = zip(*patches, strict=True)
    return Surfaces(
        corners=np.concatenate(triangles),
        colors=np.ones((sum(map(len, triangles)), 3, 3), np.float32),
        uv=np.concatenate(uv).astype(np.float32),
        image=np.repeat(np.arange(len(images), dtype=np.int32), [len(t) for t in triangles]),
        images=images,
    )


def export(surfaces: Surfaces, path: str | Path) -> None:
    """Write surfaces as a binary glTF file (.glb), y up as that format demands, all images joined in one.

    Raises ValueError for another ending, and for faces that this module did not make: without an image, tinted, or
    with an image that repeats.
    """
    if Path(path).suffix != ".glb":
        raise ValueError(f"{path}: buildings are written as binary glTF; let the name end in .glb")
    inside = (surfaces.uv >= 0).all() and (surfaces.uv <= 1).all()
    if not inside or (surfaces.image < 0).any() or (surfaces.colors != 1).any():
        raise ValueError(f"{path}: only a plan's surfaces can be written; make them with extrude.surfaces")
    atlas, places = _atlas(surfaces.images)
    size = np.array([image.shape[1::-1] for image in surfaces.images])[surfaces.image, None]
    flip = np.array([1.0, -1.0])  # rows count from the top, v from below
    texels = places[surfaces.image, None] + [0.0, 1.0] * size + flip * size * surfaces.uv
    uv = [0.0, 1.0] + flip * texels / atlas.shape[1::-1]
    paint = PBRMaterial(
        baseColorTexture=Image.fromarray(atlas), metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
    )
    mesh = trimesh.Trimesh(
        surfaces.corners.reshape(-1, 3)[:, [0, 2, 1]] * [1, 1, -1],
        np.arange(3 * len(surfaces.corners)).reshape(-1, 3),
        visual=TextureVisuals(uv=uv.reshape(-1, 2), material=paint),
        process=False,
    )
    mesh.export(path)


def _atlas(images) -> tuple[np.ndarray, np.ndarray]:
    """Images in rows under each other, the tallest first: the joint image, and the column and row (n, 2) of each.

    Around each its border goes on for `MARGIN` texels, so that a viewer's coarser copies mix no neighbours in.
    """
    framed = [np.pad(image, ((MARGIN, MARGIN), (MARGIN, MARGIN), (0, 0)), mode="edge") for image in images]
    sizes = np.array([image.shape[1::-1] for image in framed])
    width = max(sizes[:, 0].max(), math.ceil(math.sqrt(sizes.prod(1).sum())))
    places, column, row, tall = np.zeros_like(sizes), 0, 0, 0
    for k in np.argsort(-sizes[:, 1], kind="stable"):
        if column + sizes[k, 0] > width:
            column, row, tall = 0, row + tall, 0
        places[k], column, tall = (column, row), column + sizes[k, 0], max(tall, sizes[k, 1])
    atlas = np.zeros((row + tall, width, 3), np.uint8)
    for image, (x, y) in zip(framed, places, strict=True):
        atlas[y : y + image.shape[0], x : x + image.shape[1]] = image
    return atlas, places + MARGIN


def _upright(plan: Plan, blocks: list[Block], rooms: bodies.Polygons):
    """Patches of all sides, cut where they meet other bodies; between two levels the plan is that of one height."""
    standing: dict = {}  # (block, room, place) of a side: (segment, offset, low, high), as far as it has come
    done = []
    for low, high in pairwise(_levels(blocks, plan.wall_height)):
        there = [k for k, b in enumerate(blocks) if b.elevation < (low + high) / 2 < b.elevation + b.height]
        sides = faces.visible([blocks[k].footprint for k in there], rooms)
        below, standing = standing, {}
        for segment, owner, room, begin in zip(*sides, strict=True):
            side = (there[owner], int(room), *np.round(segment, 6))
            base = below.pop(side)[2] if side in below else low
            standing[side] = segment, begin, base, high
        done += below.items()
    for (k, r, *_), (segment, begin, low, high) in [*done, *standing.items()]:
        block, room = blocks[k], plan.rooms[r]
        (a, b), (c, d) = ([np.append(end, z) for end in (segment[:2], segment[2:])] for z in (low, high))
        triangles = np.array([[a, b, d], [a, d, c]])
        if bodies.signed_area(block.footprint) < 0:
            triangles = triangles[:, ::-1]
        row = (block.texture or room.texture).row(block.offset + begin)
        shades = _shades(block.color or room.wall_color, row, a, b - a)
        yield _patch(triangles, a, b - a, c - a, shades if block.color else _skirted(shades))


def _flat(plan: Plan, blocks: list[Block], rooms: bodies.Polygons):
    """Patches of tops and undersides between the floor and the ceiling, where nothing stands on or below them."""
    for k, block in enumerate(blocks):
        for top in (True, False):
            z = block.elevation + top * block.height
            if not _CLOSE < z < plan.wall_height - _CLOSE:
                continue
            covers = []
            for j, other in enumerate(blocks):
                low, high = other.elevation, other.elevation + other.height
                same = abs((high if top else low) - z) < _CLOSE
                beyond = low - _CLOSE < z < high - _CLOSE if top else low + _CLOSE < z < high + _CLOSE
                if beyond or (same and j < k):
                    covers.append(other.footprint)
            start = np.append(block.footprint[0], z)
            along = np.append(block.footprint[1], z) - start
            for index, triangles in _pieces(block.footprint, rooms, covers):
                room = plan.rooms[index]
                row = (block.texture or room.texture).row(block.offset)
                color = np.array(block.color or room.wall_color) * (TOP if top else UNDERSIDE)
                yield _level(triangles, z, _shades(color, row, start, along), up=top)


def _floors(plan: Plan, rooms: bodies.Polygons):
    """Patches of floors and ceilings. They run on under walls and furniture, so that no crack opens beside these."""
    for k, room in enumerate(plan.rooms):
        start = np.append(room.polygon.min(0), 0.0)
        for _, triangles in _pieces(room.polygon, rooms, rooms.corners[:k]):
            yield _level(triangles, 0.0, _boards(room), up=True)
            plaster = _shades(CEILING, PLASTER.row(), start, np.array([1.0, 0.0, 0.0]))
            yield _level(triangles, plan.wall_height, plaster, up=False)


def _levels(blocks: list[Block], ceiling: float) -> np.ndarray:
    """The heights, ascending from floor to ceiling, at which a body begins or ends."""
    heights = np.array([(b.elevation, b.elevation + b.height) for b in blocks]).ravel()
    return np.unique(np.round(np.append(heights[heights < ceiling], [0.0, ceiling]), 6))


def _pieces(polygon: np.ndarray, rooms: bodies.Polygons, covers):
    """The parts of a polygon (k, 2) that lie in a room and under no cover: (room, triangles (t, 3, 2)) a room."""
    hidden = bodies.Polygons(tuple(covers))
    lower, upper = polygon.min(0), polygon.max(0)
    others = faces.outline([*covers, *rooms.corners])[0]
    ends = np.sort(others.reshape(-1, 2, 2), axis=1)
    others = others[((ends[:, 0] < upper - _CLOSE) & (ends[:, 1] > lower + _CLOSE)).all(1)]
    triangles = _strips(faces.outline([polygon])[0], others) if len(others) else _ears(polygon)
    middle = triangles.mean(1)
    room = np.where(hidden.contains(middle) | ~bodies.Polygons((polygon,)).contains(middle), -1, rooms.which(middle))
    for index in np.unique(room[room >= 0]):
        yield int(index), triangles[room == index]


def _ears(polygon: np.ndarray) -> np.ndarray:
    """A simple polygon (k, 2) as triangles (k − 2, 3, 2)."""
    return polygon[mapbox_earcut.triangulate_float64(polygon, np.array([len(polygon)], np.uint32))].reshape(-1, 3, 2)


def _strips(outline: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Triangles (t, 3, 2) that cover what lies inside an outline (o, 4), and more; edges `others` (e, 4) cross none.

    Lines through all ends and crossings, upright in the plan, part it into strips where edges only lie above another.
    """
    edges = np.concatenate([outline, others])
    crossings = [edge[0] + faces.cuts(edge, edges) * (edge[2] - edge[0]) for edge in edges]
    lines = np.unique(np.clip(np.concatenate(crossings), outline[:, 0].min(), outline[:, 0].max()))
    lines = lines[np.append(True, np.diff(lines) > _CLOSE)]
    triangles = []
    for left, right in pairwise(lines):
        x0, y0, x1, y1 = edges.T
        across = (np.minimum(x0, x1) < (left + right) / 2) & ((left + right) / 2 < np.maximum(x0, x1))
        x0, y0, x1, y1 = edges[across].T
        slope = (y1 - y0) / (x1 - x0)
        heights = np.stack([y0 + slope * (left - x0), y0 + slope * (right - x0)], 1)
        heights = heights[np.argsort(heights.sum(1))]
        for (a, b), (d, c) in pairwise(heights):
            corners = np.array([[left, a], [right, b], [right, c], [left, d]])
            triangles += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    triangles = np.array(triangles).reshape(-1, 3, 2)
    return triangles[np.abs([bodies.signed_area(t) for t in triangles]) > _CLOSE**2]


def _level(triangles: np.ndarray, z: float, shades: Callable, up: bool):
    """The patch of triangles (t, 3, 2) at height z that face up or down."""
    lower, upper = triangles.min((0, 1)), triangles.max((0, 1))
    clockwise = np.array([bodies.signed_area(t) < 0 for t in triangles])
    turned = np.where((clockwise == up)[:, None, None], triangles[:, ::-1], triangles)
    across, along = np.diag(np.append(upper - lower, 0.0))[:2]
    return _patch(np.insert(turned, 2, z, axis=2), np.append(lower, z), across, along, shades)


def _patch(triangles: np.ndarray, corner: np.ndarray, across: np.ndarray, up: np.ndarray, shades: Callable):
    """(triangles, uv, image): triangles (t, 3, 3) in the rectangle that `across` and `up` span from `corner`, painted.

    `shades` gives colours (k, 3) for points (k, 3). The outermost texels lie on the rectangle's border: no blending of
    texels reaches beyond it.
    """
    axes = np.stack([across, up])
    size = np.minimum(np.ceil(np.linalg.norm(axes, axis=1) / TEXEL - 1e-9), MOST_TEXELS - 1).astype(int) + 1
    right, high = np.meshgrid(np.linspace(0, 1, size[0]), np.linspace(1, 0, size[1]))
    points = corner + right[..., None] * across + high[..., None] * up
    color = shades(points.reshape(-1, 3)).reshape(points.shape)
    image = np.rint(255 * np.clip(color, 0, 1)).astype(np.uint8)
    if (image == image[0, 0]).all():
        image, size = image[:1, :1], np.array([1, 1])
    shares = (triangles - corner) @ axes.T / (axes**2).sum(1)
    return triangles, (0.5 + shares * (size - 1)) / size, image


def _shades(color, row, start: np.ndarray, along: np.ndarray) -> Callable:
    """The colours (k, 3) at points (k, 3) of a surface, as flatland's with the texture `row`, at any height.

    Stripes run with the length along `along` from `start`; noise changes with height as fast as with place.
    """
    kind, period, contrast, phase = row
    along = along / np.linalg.norm(along)

    def stripes(points):
        return np.sin(2 * math.pi * ((points - start) @ along + phase) / period)[:, None]

    def noise(points):
        storey, share = np.divmod((points[:, 2:] - CUT) / period, 1)
        share = share**2 * (3 - 2 * share)
        places = points[:, :2] + [phase, -phase]
        # a sheet of noise a period of height: the same plane, far away
        low, high = (rays.noise_at(places + (storey + k) * [1009 * period, 0], period) for k in (0, 1))
        colorful = (1 - share) * low + share * high
        grey = colorful.mean(1, keepdims=True)
        calm = (1 - CALM) * np.clip((points[:, 2:] - CUT) / FADE, 0, 1)
        return colorful + calm * (grey - colorful)

    wave = {rays.STRIPES: stripes, rays.NOISE: noise}.get(kind, lambda points: np.zeros((len(points), 1)))
    return lambda points: np.asarray(color) * (1 + contrast * wave(points))


def _skirted(shades: Callable) -> Callable:
    """The colours of a wall above a pale skirting board."""
    return lambda points: np.where(points[:, 2:] < SKIRTING, CEILING, shades(points))


def _boards(room: plans.Room) -> Callable:
    """Colours of a floor of boards that lie along the room's longer side, each of its own shade, in broken joints."""
    long = int(np.argmax(np.ptp(room.polygon, axis=0)))
    lower = room.polygon.min(0)

    def shades(points):
        places = (points[:, :2] - lower)[:, [long, 1 - long]] / BOARD
        course = np.floor(places[:, 1])
        board = np.floor(places[:, 0] + 0.38 * course)
        shade = rays.noise_at(np.stack([board, course], 1), 1.0)[:, :1]  # at whole numbers: one number a board
        vein = rays.noise_at(places * [4.0, 5.0] + 100 * shade, 1.0)[:, :1]
        return np.asarray(room.floor_color) * (1 + GRAIN * shade + 0.4 * GRAIN * vein)

    return shades
