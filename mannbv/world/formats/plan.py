"""Floor plans: a small JSON format (data/README.md), read strictly, and the flatland world that stands in one."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mannbv.world import bodies, errors, faces
from mannbv.world.errors import SceneError
from mannbv.world.formats import entries
from mannbv.world.formats.entries import Entry
from mannbv.world.ground import Ground
from mannbv.world.segments import TEXTURES, Segments
from mannbv.world.world import World

FORMAT = "mannbv plan 1"
REACH = (0.05, 1.0)  # [m] flatland keeps what stands at some height between these; not rugs, lamps and lintels


@dataclass(frozen=True)
class Texture:
    """How a surface's colour varies: kind (a name in `TEXTURES`), period [m], contrast, phase [m]."""

    kind: str = "plain"
    period: float = 1.0
    contrast: float = 0.0
    phase: float = 0.0

    def row(self, offset: float = 0.0) -> list[float]:
        """As a row of `Segments.textures`, for a surface that begins `offset` [m] along its wall."""
        shift = offset if self.kind == "stripes" else 0.0  # noise hangs on the place in the world already
        return [float(TEXTURES[self.kind]), self.period, self.contrast, self.phase + shift]


@dataclass(frozen=True)
class Block:
    """A standing body: footprint (k, 2) [m], elevation of its underside and height [m], colour and texture.

    `color` and `texture` None: each face takes those of the room it looks on. `offset` [m]: distance of its first
    corner from the beginning of its wall.
    """

    name: str
    footprint: np.ndarray
    elevation: float
    height: float
    color: tuple[float, ...] | None
    texture: Texture | None
    offset: float = 0.0


@dataclass(frozen=True)
class Room:
    """polygon (k, 2) [m], reaching to the centre lines of its walls; the colours of its floor and walls."""

    name: str
    polygon: np.ndarray
    floor_color: tuple[float, ...]
    wall_color: tuple[float, ...]
    texture: Texture


@dataclass(frozen=True)
class Plan:
    """What a plan file says, walls already cut at their doors and windows. Lengths [m], angles [rad]."""

    name: str
    description: str
    wall_height: float
    rooms: tuple[Room, ...]
    walls: tuple[Block, ...]
    furniture: tuple[Block, ...]
    starts: np.ndarray
    goals: np.ndarray

    @property
    def inside(self) -> bodies.Polygons:
        """The rooms' polygons, to the centre lines of the walls."""
        return bodies.Polygons(tuple(room.polygon for room in self.rooms))


def read(path: str | Path) -> Plan:
    """Read a plan file. Raises SceneError, naming the file, the entry and the remedy, for anything wrong with it."""
    return _plan(entries.read(path, FORMAT))


def ground(plan: Plan, body: tuple[float, float] = REACH) -> Ground:
    """What stands in a plan between two heights above its floor [m]: walls and furniture. Raises SceneError."""
    everything = [*plan.walls, *plan.furniture]
    blocks = [b for b in everything if b.elevation < body[1] and b.elevation + b.height > body[0]]
    ends, owner, room, begin = faces.visible([block.footprint for block in blocks], plan.inside)
    colors, textures = [], []
    for k in range(len(ends)):
        block, around = blocks[owner[k]], plan.rooms[room[k]]
        colors.append(block.color or around.wall_color)
        textures.append((block.texture or around.texture).row(block.offset + begin[k]))
    walls = Segments(ends, np.array(colors, float).reshape(-1, 3), np.array(textures, float).reshape(-1, 4))
    return Ground(walls, bodies.Polygons(tuple(block.footprint for block in blocks)), plan.inside, body=body)


def load(path: str | Path) -> World:
    """The flatland world of a plan file. Raises SceneError."""
    plan = read(path)
    with errors.naming(path):
        flat = ground(plan)
    return World(plan.name, plan.description, flat.walls, flat, plan.starts, plan.goals)


def _plan(top: Entry) -> Plan:
    height = top.number("wall_height", above=0)
    rooms = tuple(
        Room(e.text("name"), e.polygon("polygon"), e.color("floor_color"), e.color("wall_color"), _texture(e))
        for e in top.children("rooms")
    )
    doors, windows = top.children("doors", []), top.children("windows", [])
    walls, used = [], set()
    for k, entry in enumerate(top.children("walls")):
        walls += _wall(entry, f"wall {k}", height, doors, windows, used)
    for window in windows:
        window.number("sill", least=0)  # what tells a window from a door
    for opening in [*doors, *windows]:
        if opening.place not in used:
            raise SceneError(f"{top.file}: {opening.place}.at lies on no wall; move it onto a wall's centre line")
    if not rooms or not walls:
        raise SceneError(f"{top.file}: a plan needs at least one of rooms and walls each; see data/README.md")
    return Plan(
        name=top.text("name"),
        description=top.text("description"),
        wall_height=height,
        rooms=rooms,
        walls=tuple(walls),
        furniture=tuple(_furniture(entry) for entry in top.children("furniture", [])),
        starts=top.array("starts", (-1, 3)),
        goals=top.array("goals", (-1, 2)),
    )


def _texture(entry: Entry) -> Texture:
    texture = entry.child("texture", entry.get("texture"))
    kind = texture.text("kind")
    if kind not in TEXTURES:
        texture.fail("kind", "one of " + ", ".join(TEXTURES), kind)
    period, contrast = texture.number("period", 1.0, above=0), texture.number("contrast", 0.0, least=0)
    return Texture(kind, period, contrast, texture.number("phase", 0.0))


def _furniture(entry: Entry) -> Block:
    if "polygon" in entry.values:
        footprint = entry.polygon("polygon")
    else:
        box = entry.child("box", entry.get("box"))
        size, yaw = box.array("size", (2,)), box.number("yaw", 0.0)
        if size.min() <= 0:
            box.fail("size", "two positive lengths [m]", size.tolist())
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2
        footprint = box.array("center", (2,)) + corners @ bodies.turn(yaw).T
    return Block(
        name=entry.text("name"),
        footprint=footprint,
        elevation=entry.number("elevation", 0.0, least=0),
        height=entry.number("height", above=0),
        color=entry.color("color"),
        texture=_texture(entry) if "texture" in entry.values else Texture(),
    )


def _wall(entry: Entry, name: str, height: float, doors: list, windows: list, used: set) -> list[Block]:
    """The bodies of one wall: what its openings leave, closed doors and windows. Its ends reach half a thickness
    beyond its centre line, so that corners close."""
    start, end = entry.array("from", (2,)), entry.array("to", (2,))
    thickness, height = entry.number("thickness", above=0), entry.number("height", height, above=0)
    length = float(np.linalg.norm(end - start))
    if length < 1e-6:
        entry.fail("to", "another point than from", end.tolist())
    along = (end - start) / length
    color = entry.color("color") if "color" in entry.values else None
    texture = _texture(entry) if "texture" in entry.values else None

    def block(low, high, elevation=0.0, top=height, color=color, texture=texture):
        corners = np.array([[low, -1], [high, -1], [high, 1], [low, 1]]) * [1.0, thickness / 2]
        footprint = start + corners @ np.stack([along, [-along[1], along[0]]])
        return Block(name, footprint, elevation, top - elevation, color, texture, low)

    blocks, begin = [], -thickness / 2
    for place, half, opening in sorted(_on_wall(start, along, length, [*doors, *windows]), key=lambda o: o[0]):
        used.add(opening.place)
        if place - half < max(begin, 0.0) - 1e-9 or place + half > length:
            raise SceneError(f"{entry.file}: {opening.place} overlaps another opening or the end of its wall; move it")
        if place - half > begin:
            blocks.append(block(begin, place - half))
        blocks += _filling(opening, place - half, place + half, height, block)
        begin = place + half
    return [*blocks, block(begin, length + thickness / 2)]


def _on_wall(start, along, length: float, openings: list) -> list[tuple]:
    """(distance of the middle from the wall's beginning, half width, entry) of the openings on a wall."""
    found = []
    for opening in openings:
        offset = opening.array("at", (2,)) - start
        if abs(along[0] * offset[1] - along[1] * offset[0]) < 0.01 and 0 < offset @ along < length:
            found.append((float(offset @ along), opening.number("width", above=0) / 2, opening))
    return found


def _filling(opening: Entry, low: float, high: float, height: float, block) -> list[Block]:
    """What stands in an opening: a window's pane and sill, the leaf of a closed door, the wall above.

    The pane comes first: where flatland cuts through pane and sill, one sees the pane.
    """
    sill = opening.number("sill", 0.0, least=0)
    top = min(sill + opening.number("height", above=0), height)
    is_open = opening.get("open", "sill" not in opening.values)
    if not isinstance(is_open, bool):
        opening.fail("open", "true or false", is_open)
    parts = [] if is_open else [block(low, high, sill, top, opening.color("color"), Texture())]
    parts += [block(low, high, 0.0, sill)] if sill > 0 else []
    return parts + ([block(low, high, top, height)] if top < height else [])
