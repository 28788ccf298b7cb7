"""Writes the four bundled floor plans; their format is described in README.md beside this file.

    python data/make_scenes.py [FOLDER]      the folder of this file by default

Plain Python without dependencies and without chance: the same files come out byte for byte.
"""

import json
import math
import sys
from pathlib import Path

WOOD, OAK, WALNUT = [0.62, 0.44, 0.26], [0.76, 0.60, 0.38], [0.40, 0.26, 0.17]
WHITE, GREY, STEEL, BLACK = [0.88, 0.88, 0.86], [0.55, 0.55, 0.57], [0.66, 0.70, 0.74], [0.18, 0.18, 0.20]
RED, BLUE, GREEN, YELLOW = [0.72, 0.22, 0.20], [0.22, 0.36, 0.66], [0.24, 0.50, 0.28], [0.86, 0.70, 0.22]
TEAL, PURPLE, LINEN = [0.16, 0.52, 0.54], [0.50, 0.30, 0.58], [0.82, 0.76, 0.66]
PANE, LEAF, TILES = [0.62, 0.80, 0.92], [0.46, 0.22, 0.14], [0.70, 0.72, 0.72]


def rectangle(x0, y0, x1, y1):
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


def stripes(period, contrast=0.35):
    return {"kind": "stripes", "period": period, "contrast": contrast}


def noise(period, contrast=0.5, phase=0.0):
    return {"kind": "noise", "period": period, "contrast": contrast, "phase": phase}


def room(name, polygon, wall_color, texture, floor_color=OAK):
    return {"name": name, "polygon": polygon, "floor_color": floor_color, "wall_color": wall_color, "texture": texture}


def walls(thickness, *lines):
    return [{"from": [x0, y0], "to": [x1, y1], "thickness": thickness} for x0, y0, x1, y1 in lines]


def door(x, y, width=0.9, height=2.1):
    return {"at": [x, y], "width": width, "height": height, "open": True}


def closed_door(x, y, width=1.0, color=LEAF):
    return {"at": [x, y], "width": width, "height": 2.1, "open": False, "color": color}


def window(x, y, width=1.4, sill=0.9, height=1.3):
    return {"at": [x, y], "width": width, "sill": sill, "height": height, "color": PANE}


def box(name, x, y, width, depth, height, color, yaw=0.0, elevation=0.0, texture=None):
    """A box around (x, y), `width` along x and `depth` along y before it is turned by `yaw` [rad]."""
    shape = {"center": [x, y], "size": [width, depth]} | ({"yaw": yaw} if yaw else {})
    return piece(name, {"box": shape}, height, color, elevation, texture)


def disc(name, x, y, radius, height, color, elevation=0.0, texture=None):
    """A round thing, as a polygon with twelve corners."""
    angles = [math.pi * k / 6 for k in range(12)]
    corners = [[round(x + radius * math.cos(a), 3), round(y + radius * math.sin(a), 3)] for a in angles]
    return piece(name, {"polygon": corners}, height, color, elevation, texture)


def piece(name, shape, height, color, elevation=0.0, texture=None):
    texture = texture or noise(0.35, 0.4)
    return {"name": name, **shape, "elevation": elevation, "height": height, "color": color, "texture": texture}


def around(name, x, y, offsets, size, height, color, yaw=0.0):
    """Equal boxes, say chairs, at offsets from (x, y) that turn with `yaw` [rad]."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    places = [(round(x + cos * u - sin * v, 3), round(y + sin * u + cos * v, 3)) for u, v in offsets]
    return [box(f"{name} {k + 1}", px, py, size, size, height, color, yaw) for k, (px, py) in enumerate(places)]


def degrees(*places):
    """Starts given as x, y and a heading in degrees."""
    return [[x, y, round(math.radians(heading), 6)] for x, y, heading in places]


def flat():
    """10.0 × 7.6 m: living room, hall, kitchen and study form a loop around the bathroom."""
    return {
        "name": "flat",
        "description": "a small flat whose rooms form a loop around the bathroom",
        "wall_height": 2.6,
        "rooms": [
            room("living room", rectangle(0, 0, 3.8, 7.6), [0.80, 0.52, 0.34], noise(0.9)),
            room("hall", rectangle(3.8, 0, 6.2, 4.3), [0.78, 0.74, 0.52], stripes(0.6), TILES),
            room("bathroom", rectangle(3.8, 4.3, 6.2, 6.0), [0.36, 0.64, 0.70], stripes(0.4, 0.25), TILES),
            room("study", rectangle(3.8, 6.0, 6.2, 7.6), [0.56, 0.40, 0.62], noise(0.6)),
            room("kitchen", rectangle(6.2, 2.9, 10, 7.6), [0.50, 0.66, 0.40], noise(0.7, 0.45, 5.0), TILES),
            room("bedroom", rectangle(6.2, 0, 10, 2.9), [0.42, 0.50, 0.74], stripes(0.8, 0.3)),
        ],
        "walls": walls(0.24, (0, 0, 10, 0), (10, 0, 10, 7.6), (10, 7.6, 0, 7.6), (0, 7.6, 0, 0))
        + walls(0.1, (3.8, 0, 3.8, 7.6), (6.2, 0, 6.2, 7.6), (6.2, 2.9, 10, 2.9))
        + walls(0.1, (3.8, 4.3, 6.2, 4.3), (3.8, 6.0, 6.2, 6.0)),
        "doors": [
            closed_door(5.0, 0),
            door(3.8, 1.4),
            door(6.2, 1.4),
            door(6.2, 3.6),
            door(5.0, 4.3),
            door(6.2, 6.6),
            door(3.8, 6.6),
        ],
        "windows": [window(0, 2.6, 2.0), window(0, 5.4), window(5.0, 7.6), window(8.4, 7.6), window(8.4, 0)],
        "furniture": [
            box("sofa", 0.65, 2.6, 0.9, 2.0, 0.8, RED),
            box("coffee table", 1.75, 2.6, 0.55, 1.0, 0.45, OAK),
            box("armchair", 1.6, 4.2, 0.8, 0.8, 0.8, TEAL, yaw=0.5),
            box("television board", 3.55, 3.2, 0.36, 1.6, 1.1, BLACK),
            box("desk", 0.55, 6.4, 0.75, 1.5, 0.74, WOOD),
            box("desk chair", 1.3, 6.4, 0.45, 0.45, 0.9, BLUE, yaw=0.3),
            box("bookcase", 2.2, 7.28, 1.5, 0.32, 2.0, WALNUT, texture=stripes(0.3, 0.4)),
            disc("plant", 0.5, 0.5, 0.22, 1.2, GREEN),
            box("rug", 1.9, 2.6, 2.2, 2.4, 0.01, LINEN),
            box("coat cabinet", 4.07, 3.0, 0.42, 1.3, 1.9, WHITE, texture=stripes(0.45, 0.25)),
            box("bathtub", 5.79, 5.15, 0.7, 1.55, 0.6, WHITE),
            box("basin", 4.1, 4.68, 0.48, 0.55, 0.85, WHITE),
            box("toilet", 4.2, 5.6, 0.65, 0.4, 0.45, WHITE),
            box("book shelf", 5.0, 7.32, 1.7, 0.3, 2.0, WALNUT, texture=stripes(0.25, 0.4)),
            box("kitchen counter", 9.57, 4.6, 0.6, 3.2, 0.9, STEEL, texture=stripes(0.6, 0.3)),
            box("wall cupboards", 9.7, 4.6, 0.35, 3.2, 0.7, WHITE, elevation=1.45),
            box("fridge", 9.54, 6.9, 0.66, 0.66, 1.9, GREY),
            box("dining table", 7.8, 5.2, 0.85, 1.4, 0.75, OAK),
            *around("chair", 7.8, 5.2, [(-0.65, -0.35), (-0.65, 0.35), (0.65, -0.35), (0.65, 0.35)], 0.4, 0.9, YELLOW),
            box("bed", 8.85, 1.45, 2.0, 1.6, 0.55, BLUE),
            box("night stand 1", 9.65, 0.4, 0.4, 0.4, 0.5, OAK),
            box("night stand 2", 9.65, 2.55, 0.4, 0.4, 0.5, OAK),
            box("wardrobe", 7.15, 2.55, 1.6, 0.56, 2.1, LINEN, texture=stripes(0.5, 0.25)),
            disc("lamp", 7.8, 5.2, 0.25, 0.3, YELLOW, elevation=1.6),
        ],
        "starts": degrees(
            (2.6, 0.8, 0),
            (8.0, 6.9, 180),
            (2.9, 5.0, 90),
            (5.2, 0.9, 90),
            (6.9, 0.9, 180),
            (8.6, 3.5, 180),
            (5.3, 6.5, 180),
            (1.4, 5.3, -90),
            (5.1, 2.2, -90),
            (7.0, 4.0, 180),
        ),
        "goals": [
            [8.7, 6.7],
            [1.4, 1.0],
            [7.4, 0.7],
            [2.6, 6.2],
            [7.2, 6.7],
            [2.9, 0.9],
            [5.4, 3.0],
            [8.6, 3.7],
            [5.0, 6.5],
            [3.0, 4.6],
        ],
    }


def corridor():
    """18.0 × 9.4 m: offices on both sides of a corridor; several have a second door."""
    return {
        "name": "corridor",
        "description": "an office floor: eight side rooms along a corridor",
        "wall_height": 2.8,
        "rooms": [
            room("corridor", rectangle(0, 3.8, 18, 5.6), [0.72, 0.70, 0.64], noise(1.0, 0.45), GREY),
            room("office A", rectangle(0, 0, 4.5, 3.8), [0.44, 0.54, 0.76], stripes(0.8, 0.3)),
            room("archive", rectangle(4.5, 0, 7.5, 3.8), [0.58, 0.46, 0.36], noise(0.6), GREY),
            room("meeting room", rectangle(7.5, 0, 12.5, 3.8), [0.74, 0.40, 0.36], stripes(1.0, 0.3)),
            room("laboratory", rectangle(12.5, 0, 18, 3.8), [0.44, 0.66, 0.52], noise(0.8, 0.5, 3.0), TILES),
            room("office B", rectangle(0, 5.6, 5, 9.4), [0.78, 0.66, 0.36], noise(0.9, 0.45, 7.0)),
            room("kitchenette", rectangle(5, 5.6, 8.5, 9.4), [0.82, 0.56, 0.40], stripes(0.5, 0.3), TILES),
            room("washroom", rectangle(8.5, 5.6, 10.5, 9.4), [0.46, 0.70, 0.76], stripes(0.4, 0.25), TILES),
            room("open office", rectangle(10.5, 5.6, 18, 9.4), [0.60, 0.48, 0.68], noise(0.8, 0.5, 1.0)),
        ],
        "walls": walls(0.3, (0, 0, 18, 0), (18, 0, 18, 9.4), (18, 9.4, 0, 9.4), (0, 9.4, 0, 0))
        + walls(0.12, (0, 3.8, 18, 3.8), (0, 5.6, 18, 5.6))
        + walls(0.12, (4.5, 0, 4.5, 3.8), (7.5, 0, 7.5, 3.8), (12.5, 0, 12.5, 3.8))
        + walls(0.12, (5, 5.6, 5, 9.4), (8.5, 5.6, 8.5, 9.4), (10.5, 5.6, 10.5, 9.4), (9.5, 8.1, 9.5, 9.4)),
        "doors": [
            closed_door(0, 4.7, 1.2, TEAL),
            door(3.6, 3.8),
            door(6.0, 3.8),
            door(8.4, 3.8, 1.0),
            door(11.6, 3.8, 1.0),
            door(12.5, 1.2, 1.0),
            door(13.6, 3.8, 1.0),
            door(1.3, 5.6),
            door(6.0, 5.6),
            door(5.0, 8.0),
            door(9.5, 5.6),
            door(11.6, 5.6, 1.0),
            door(16.8, 5.6, 1.0),
        ],
        "windows": [
            window(18, 4.7, 1.0),
            *(window(x, 0, 1.6) for x in (2.2, 10.0, 14.2, 16.4)),
            *(window(x, 9.4, 1.6) for x in (2.5, 6.8, 12.4, 14.4, 16.6)),
        ],
        "furniture": [
            box("filing cabinet", 10.0, 4.03, 1.4, 0.34, 1.2, STEEL, texture=stripes(0.35, 0.3)),
            box("bench", 3.4, 5.36, 1.6, 0.34, 0.45, RED),
            box("noticeboard", 14.4, 5.44, 1.6, 0.2, 1.9, BLUE, texture=noise(0.25)),
            disc("corridor plant", 17.5, 5.2, 0.22, 1.4, GREEN),
            box("desk A1", 0.6, 1.2, 0.8, 1.6, 0.74, OAK),
            box("desk A2", 0.6, 2.95, 0.8, 1.3, 0.74, OAK),
            box("chair A1", 1.3, 1.2, 0.45, 0.45, 0.9, BLACK, yaw=0.4),
            box("chair A2", 1.35, 2.8, 0.45, 0.45, 0.9, RED, yaw=-0.3),
            box("shelf A", 3.2, 0.33, 1.8, 0.34, 1.8, WALNUT, texture=stripes(0.3, 0.4)),
            disc("table A", 2.9, 1.9, 0.4, 0.72, WHITE),
            box("rack 1", 4.8, 1.75, 0.45, 3.0, 2.2, STEEL, texture=stripes(0.5, 0.4)),
            box("rack 2", 7.2, 1.75, 0.45, 3.0, 2.2, BLUE, texture=stripes(0.4, 0.4)),
            box("rack 3", 6.0, 1.3, 0.6, 2.2, 2.2, YELLOW, texture=stripes(0.45, 0.4)),
            box("meeting table", 10.0, 1.8, 2.6, 1.1, 0.75, WALNUT),
            *around(
                "meeting chair",
                10.0,
                1.8,
                [(u, v) for v in (-0.85, 0.85) for u in (-0.85, 0.0, 0.85)],
                0.44,
                0.9,
                BLACK,
            ),
            box("sideboard", 7.83, 1.8, 0.42, 1.8, 0.9, OAK),
            box("bench top", 15.6, 0.52, 4.0, 0.7, 0.9, STEEL, texture=stripes(0.6, 0.3)),
            box("robot table", 15.5, 2.3, 2.2, 0.9, 0.9, YELLOW),
            box("gas cabinet", 17.6, 2.7, 0.45, 1.4, 1.9, RED, texture=stripes(0.5, 0.3)),
            disc("stool 1", 14.6, 1.4, 0.2, 0.6, BLACK),
            disc("stool 2", 16.6, 1.4, 0.2, 0.6, BLACK),
            box("desk B1", 0.6, 7.1, 0.8, 1.5, 0.74, OAK),
            box("desk B2", 0.6, 8.45, 0.8, 1.0, 0.74, WALNUT),
            box("chair B1", 1.35, 7.1, 0.45, 0.45, 0.9, TEAL, yaw=0.2),
            box("cabinet B", 2.9, 9.03, 2.0, 0.4, 1.8, LINEN, texture=stripes(0.5, 0.3)),
            disc("table B", 3.2, 7.3, 0.5, 0.72, WHITE),
            *around("visitor chair", 3.2, 7.3, [(0.0, -0.75), (0.75, 0.2)], 0.42, 0.9, BLUE, yaw=0.3),
            box("sofa B", 3.9, 5.98, 1.6, 0.6, 0.8, PURPLE),
            box("kitchen counter", 7.0, 8.93, 2.6, 0.62, 0.9, WHITE, texture=stripes(0.6, 0.3)),
            box("kitchen cupboards", 7.0, 9.07, 2.6, 0.35, 0.7, WHITE, elevation=1.45),
            box("bistro table", 7.3, 7.2, 0.8, 0.8, 0.75, OAK, yaw=0.4),
            *around("bistro chair", 7.3, 7.2, [(-0.7, 0.0), (0.7, 0.0)], 0.4, 0.9, GREEN, yaw=0.4),
            box("fridge", 8.1, 5.99, 0.62, 0.62, 1.9, GREY),
            box("basins", 8.81, 6.9, 0.46, 1.3, 0.85, WHITE, texture=stripes(0.65, 0.3)),
            box("toilet 1", 9.0, 8.9, 0.4, 0.65, 0.45, WHITE),
            box("toilet 2", 10.0, 8.9, 0.4, 0.65, 0.45, WHITE),
            box("desk island 1", 12.7, 7.8, 1.5, 1.5, 0.74, OAK),
            box("desk island 2", 15.5, 7.8, 1.5, 1.5, 0.74, LINEN),
            box("screen", 14.1, 7.6, 0.08, 1.8, 1.5, TEAL),
            *around("desk chair 1", 12.7, 7.8, [(-1.05, 0.0), (0.0, -1.05)], 0.45, 0.9, BLACK, yaw=0.15),
            *around("desk chair 2", 15.5, 7.8, [(1.05, 0.0), (0.0, -1.05)], 0.45, 0.9, RED, yaw=-0.2),
            box("printer", 17.55, 8.8, 0.55, 0.6, 1.0, WHITE),
            box("shelf", 10.76, 8.0, 0.38, 1.8, 1.8, WALNUT, texture=stripes(0.3, 0.4)),
            disc("office plant", 17.4, 6.6, 0.25, 1.3, GREEN),
            *(box(f"ceiling lamp {k + 1}", 3.0 + 4 * k, 4.7, 1.2, 0.2, 0.1, WHITE, elevation=2.6) for k in range(4)),
        ],
        "starts": degrees(
            (1.0, 4.7, 0),
            (17.0, 4.7, 180),
            (5.5, 4.5, 0),
            (12.6, 4.8, 180),
            (9.0, 4.9, 180),
            (3.0, 3.0, 90),
            (11.6, 6.6, -90),
            (7.1, 6.2, 180),
            (13.6, 2.9, 90),
            (8.4, 3.2, 90),
        ),
        "goals": [
            [8.2, 0.6],
            [9.6, 6.7],
            [13.4, 1.9],
            [4.3, 8.4],
            [16.7, 6.7],
            [6.1, 8.1],
            [17.3, 1.4],
            [2.4, 1.0],
            [11.5, 8.7],
            [2.2, 8.2],
        ],
    }


def openplan():
    """13.0 × 9.6 m: kitchen, dining and living share one cluttered space; three rooms are closed off."""
    return {
        "name": "openplan",
        "description": "a cluttered open-plan house with three closed rooms",
        "wall_height": 3.0,
        "rooms": [
            room("living area", rectangle(0, 0, 5, 4.8), [0.76, 0.46, 0.34], noise(0.9, 0.5, 2.0)),
            room("kitchen area", rectangle(0, 4.8, 4.4, 9.6), [0.46, 0.66, 0.62], stripes(0.7, 0.3), TILES),
            room("dining area", rectangle(4.4, 4.8, 9, 9.6), [0.76, 0.68, 0.40], noise(0.8, 0.5, 4.0)),
            room("entry", rectangle(5, 0, 9, 4.8), [0.56, 0.48, 0.70], stripes(0.9, 0.35), GREY),
            room("office", rectangle(9, 0, 13, 3.6), [0.40, 0.52, 0.72], noise(0.7)),
            room("bathroom", rectangle(9, 3.6, 13, 5.6), [0.40, 0.70, 0.78], stripes(0.4, 0.25), TILES),
            room("bedroom", rectangle(9, 5.6, 13, 9.6), [0.70, 0.44, 0.54], noise(0.9, 0.45, 6.0)),
        ],
        "walls": walls(0.3, (0, 0, 13, 0), (13, 0, 13, 9.6), (13, 9.6, 0, 9.6), (0, 9.6, 0, 0))
        + walls(0.12, (9, 0, 9, 9.6), (9, 3.6, 13, 3.6), (9, 5.6, 13, 5.6))
        + walls(0.12, (0, 4.8, 1.8, 4.8), (4.4, 9.6, 4.4, 7.9), (5, 0, 5, 1.0)),
        "doors": [
            closed_door(7.0, 0, 1.1, TEAL),
            door(9, 1.8),
            door(9, 4.6),
            door(9, 7.0),
            door(11.2, 5.6),
        ],
        "windows": [
            window(0, 2.0, 2.4, 0.4, 2.0),
            window(2.4, 0, 1.8),
            window(0, 7.4),
            window(2.1, 9.6),
            window(6.6, 9.6, 2.2, 0.4, 2.0),
            window(11.2, 9.6),
            window(13, 1.6),
        ],
        "furniture": [
            piece(
                "corner sofa",
                {"polygon": [[0.3, 0.35], [3.0, 0.35], [3.0, 1.25], [1.2, 1.25], [1.2, 3.0], [0.3, 3.0]]},
                0.8,
                BLUE,
            ),
            disc("coffee table", 2.3, 2.35, 0.45, 0.4, OAK),
            box("armchair", 3.9, 2.7, 0.85, 0.85, 0.8, RED, yaw=0.6),
            box("piano", 4.15, 0.45, 1.4, 0.55, 1.1, BLACK),
            box("fireplace", 4.5, 4.85, 1.3, 0.7, 3.0, [0.62, 0.34, 0.26], texture=stripes(0.5, 0.4)),
            box("low shelf", 5.4, 2.3, 0.36, 1.5, 0.9, WALNUT, texture=stripes(0.3, 0.4)),
            box("floor lamp", 0.45, 4.3, 0.3, 0.3, 1.6, YELLOW),
            box("rug", 2.4, 2.4, 2.4, 2.0, 0.01, LINEN, yaw=0.2),
            box("kitchen counter west", 0.45, 7.2, 0.6, 3.4, 0.9, WHITE, texture=stripes(0.6, 0.3)),
            box("kitchen counter north", 2.2, 9.14, 2.6, 0.62, 0.9, WHITE, texture=stripes(0.6, 0.3)),
            box("extractor hood", 2.2, 9.2, 0.9, 0.5, 0.6, STEEL, elevation=1.6),
            box("kitchen island", 2.2, 7.1, 0.9, 1.8, 0.9, GREY),
            disc("bar stool 1", 3.0, 6.6, 0.19, 0.7, YELLOW),
            disc("bar stool 2", 3.0, 7.5, 0.19, 0.7, YELLOW),
            box("fridge", 0.5, 5.19, 0.7, 0.6, 1.9, STEEL),
            box("dining table", 6.7, 7.0, 2.1, 1.0, 0.75, WOOD, yaw=0.35),
            *around(
                "dining chair",
                6.7,
                7.0,
                [(-0.65, -0.8), (0.0, -0.8), (0.65, -0.8), (-0.65, 0.8), (0.0, 0.8), (0.65, 0.8)],
                0.42,
                0.9,
                GREEN,
                yaw=0.35,
            ),
            box("sideboard", 6.4, 9.22, 1.8, 0.42, 0.9, WALNUT),
            box("china cabinet", 8.72, 8.8, 0.4, 1.0, 1.9, LINEN, texture=stripes(0.4, 0.3)),
            disc("column 1", 6.3, 4.3, 0.18, 3.0, WHITE, texture=noise(0.3)),
            disc("column 2", 7.9, 4.9, 0.18, 3.0, WHITE, texture=noise(0.3)),
            box("shoe bench", 8.74, 3.1, 0.38, 1.2, 0.5, OAK),
            box("play table", 7.3, 2.5, 0.8, 0.6, 0.5, RED, yaw=0.8),
            disc("ball pit", 6.35, 1.3, 0.45, 0.4, BLUE),
            disc("pot plant", 8.6, 0.5, 0.24, 1.3, GREEN),
            box("desk", 12.45, 1.5, 0.75, 1.8, 0.74, OAK),
            box("desk chair", 11.75, 1.5, 0.48, 0.48, 0.95, BLACK, yaw=0.5),
            box("office shelf", 10.8, 0.33, 2.2, 0.34, 1.9, WALNUT, texture=stripes(0.3, 0.4)),
            box("day bed", 11.4, 3.1, 1.9, 0.85, 0.5, PURPLE),
            box("bathtub", 12.45, 4.6, 0.75, 1.7, 0.6, WHITE),
            box("double basin", 10.7, 3.9, 1.2, 0.46, 0.85, WHITE),
            box("toilet", 10.0, 5.2, 0.4, 0.62, 0.45, WHITE),
            box("bed", 11.2, 8.42, 1.8, 2.05, 0.55, TEAL),
            box("night stand 1", 10.02, 9.22, 0.44, 0.4, 0.5, OAK),
            box("night stand 2", 12.38, 9.22, 0.44, 0.4, 0.5, OAK),
            box("wardrobe", 12.52, 6.6, 0.62, 1.5, 2.1, LINEN, texture=stripes(0.5, 0.25)),
            box("dresser", 9.32, 8.7, 0.44, 1.2, 0.9, WOOD),
            disc("pendant", 6.7, 7.0, 0.3, 0.3, RED, elevation=1.7),
        ],
        "starts": degrees(
            (2.0, 4.1, 0),
            (8.2, 0.9, 90),
            (1.4, 5.9, 0),
            (8.2, 9.0, -90),
            (9.8, 2.8, 180),
            (9.9, 6.4, 180),
            (5.2, 6.2, -90),
            (7.5, 3.4, 180),
            (3.7, 8.4, -90),
            (11.3, 4.6, 180),
        ),
        "goals": [
            [11.6, 6.6],
            [3.5, 5.8],
            [8.3, 6.0],
            [1.7, 1.9],
            [4.9, 8.9],
            [6.4, 2.5],
            [10.2, 1.2],
            [1.4, 7.9],
            [7.9, 1.3],
            [3.4, 3.8],
        ],
    }


def wings():
    """An L of 20 × 8 m and 8 × 10 m: two wings of rooms along corridors meet in a hall."""
    return {
        "name": "wings",
        "description": "a large house: two wings meet in a living hall",
        "wall_height": 2.8,
        "rooms": [
            room("living hall", rectangle(0, 0, 8, 5), [0.76, 0.54, 0.36], noise(1.0)),
            room("dining room", rectangle(0, 5, 8, 8), [0.50, 0.62, 0.40], stripes(0.9, 0.35)),
            room("east corridor", rectangle(8, 3.4, 20, 5), [0.74, 0.72, 0.66], noise(0.9, 0.5, 3.0)),
            room("study", rectangle(8, 0, 12.5, 3.4), [0.44, 0.40, 0.66], stripes(0.7, 0.35)),
            room("music room", rectangle(12.5, 0, 16, 3.4), [0.72, 0.40, 0.42], noise(0.7, 0.5, 5.0)),
            room("guest room", rectangle(16, 0, 20, 3.4), [0.40, 0.62, 0.66], stripes(0.8, 0.3)),
            room("bedroom 1", rectangle(8, 5, 12, 8), [0.46, 0.54, 0.76], noise(0.9, 0.45, 8.0)),
            room("bathroom", rectangle(12, 5, 14.5, 8), [0.60, 0.76, 0.78], stripes(0.4, 0.25), TILES),
            room("bedroom 2", rectangle(14.5, 5, 20, 8), [0.78, 0.62, 0.64], noise(0.8, 0.45, 1.0)),
            room("north gallery", rectangle(6.2, 8, 8, 18), [0.66, 0.60, 0.76], noise(1.0, 0.5, 9.0)),
            room("kitchen", rectangle(0, 8, 6.2, 12), [0.84, 0.74, 0.44], stripes(0.6, 0.3), TILES),
            room("library", rectangle(0, 12, 6.2, 15), [0.48, 0.32, 0.24], noise(0.6, 0.5, 4.0)),
            room("studio", rectangle(0, 15, 6.2, 18), [0.44, 0.70, 0.54], stripes(1.0, 0.35)),
        ],
        "walls": walls(0.3, (0, 0, 20, 0), (20, 0, 20, 8), (20, 8, 8, 8), (8, 8, 8, 18), (8, 18, 0, 18), (0, 18, 0, 0))
        + walls(0.14, (8, 0, 8, 8), (0, 8, 8, 8), (0, 5, 8, 5))
        + walls(0.12, (8, 3.4, 20, 3.4), (8, 5, 20, 5), (12.5, 0, 12.5, 3.4), (16, 0, 16, 3.4))
        + walls(0.12, (12, 5, 12, 8), (14.5, 5, 14.5, 8))
        + walls(0.12, (6.2, 8, 6.2, 18), (0, 12, 6.2, 12), (0, 15, 6.2, 15)),
        "doors": [
            closed_door(4.0, 0, 1.2, TEAL),
            door(2.0, 5, 1.6),
            door(6.4, 5, 1.6),
            door(8, 4.2, 1.2),
            door(10.0, 3.4),
            door(14.2, 3.4),
            door(17.2, 3.4),
            door(16, 1.6),
            door(9.4, 5),
            door(13.2, 5),
            door(16.0, 5),
            door(12, 6.2),
            door(14.5, 6.2),
            door(7.1, 8, 1.2),
            door(2.2, 8, 1.2),
            door(6.2, 9.6),
            door(3.2, 12),
            door(6.2, 13.5),
            door(1.6, 15),
            door(6.2, 16.6),
        ],
        "windows": [
            window(1.8, 0, 1.8, 0.4, 2.0),
            window(6.2, 0, 1.8, 0.4, 2.0),
            *(window(x, 0, 1.6) for x in (10.2, 14.2, 18.0)),
            window(20, 4.2, 0.8),
            *(window(x, 8, 1.6) for x in (10.0, 17.2)),
            *(window(8, y, 1.6) for y in (11.0, 13.5, 16.0)),
            *(window(0, y, 1.6) for y in (2.4, 6.5, 10.0, 16.5)),
            window(3.2, 18, 2.0),
            window(7.1, 18, 0.8),
        ],
        "furniture": [
            box("sofa 1", 2.6, 1.0, 2.2, 0.9, 0.8, RED),
            box("sofa 2", 0.65, 2.6, 0.9, 1.8, 0.8, RED),
            box("coffee table", 2.4, 2.5, 1.1, 0.7, 0.4, WALNUT),
            box("armchair", 4.4, 2.7, 0.85, 0.85, 0.8, TEAL, yaw=-0.5),
            box("fireplace", 4.2, 4.72, 1.6, 0.42, 2.8, [0.60, 0.34, 0.28], texture=stripes(0.5, 0.4)),
            box("console", 6.2, 0.36, 1.4, 0.4, 0.85, OAK),
            disc("column 1", 6.6, 2.2, 0.2, 2.8, WHITE, texture=noise(0.3)),
            disc("hall plant", 7.5, 0.6, 0.25, 1.4, GREEN),
            box("hall rug", 2.4, 2.5, 3.0, 2.0, 0.01, LINEN),
            box("dining table", 4.2, 6.6, 2.6, 1.0, 0.75, WOOD),
            *around(
                "dining chair",
                4.2,
                6.6,
                [(u, v) for v in (-0.75, 0.75) for u in (-0.85, 0.0, 0.85)],
                0.42,
                0.9,
                GREEN,
            ),
            box("sideboard", 0.4, 6.6, 0.45, 1.6, 0.9, WALNUT),
            box("east bench", 12.0, 4.76, 1.4, 0.34, 0.45, BLUE),
            box("east console", 18.4, 3.64, 1.2, 0.34, 0.85, OAK),
            disc("east plant", 19.5, 4.6, 0.22, 1.3, GREEN),
            box("desk", 10.3, 1.4, 1.6, 0.8, 0.74, WALNUT),
            box("desk chair", 10.3, 0.7, 0.48, 0.48, 0.95, BLACK, yaw=0.3),
            box("book wall", 12.25, 1.7, 0.34, 2.8, 2.3, WALNUT, texture=stripes(0.3, 0.45)),
            box("reading chair", 8.7, 0.8, 0.8, 0.8, 0.9, YELLOW, yaw=0.5),
            piece(
                "grand piano",
                {"polygon": [[13.2, 0.5], [14.7, 0.5], [14.7, 1.1], [13.9, 2.0], [13.2, 2.0]]},
                1.0,
                BLACK,
            ),
            box("piano stool", 14.95, 0.8, 0.3, 0.6, 0.5, RED),
            box("harp", 15.6, 2.9, 0.4, 0.6, 1.7, YELLOW, yaw=0.4),
            box("guest bed", 18.75, 1.3, 2.0, 1.5, 0.55, PURPLE),
            box("guest wardrobe", 16.9, 0.46, 1.2, 0.56, 2.1, LINEN, texture=stripes(0.4, 0.3)),
            box("bed 1", 10.4, 6.85, 1.7, 2.0, 0.55, BLUE),
            box("wardrobe 1", 8.42, 7.2, 0.6, 1.2, 2.1, WHITE, texture=stripes(0.5, 0.25)),
            box("night stand", 11.5, 7.6, 0.42, 0.4, 0.5, OAK),
            box("bathtub", 13.25, 7.4, 1.7, 0.8, 0.6, WHITE),
            box("vanity", 14.2, 5.38, 0.46, 0.6, 0.85, WHITE),
            box("toilet", 12.36, 5.4, 0.6, 0.4, 0.45, WHITE),
            box("bed 2", 18.6, 6.6, 2.1, 1.8, 0.55, RED),
            box("dresser", 16.4, 7.6, 1.4, 0.44, 0.9, WOOD),
            box("vanity table", 17.9, 5.3, 1.0, 0.42, 0.75, WHITE),
            box("gallery bench 1", 7.64, 11.0, 0.36, 1.4, 0.45, TEAL),
            box("gallery bench 2", 7.64, 15.4, 0.36, 1.4, 0.45, RED),
            box("pedestal", 6.5, 12.0, 0.36, 0.36, 1.1, WHITE, texture=noise(0.25)),
            disc("gallery plant", 7.5, 17.5, 0.22, 1.4, GREEN),
            box("kitchen counter", 0.46, 10.2, 0.62, 3.2, 0.9, STEEL, texture=stripes(0.6, 0.3)),
            box("kitchen cupboards", 0.33, 10.2, 0.35, 3.2, 0.7, WHITE, elevation=1.45),
            box("kitchen island", 3.2, 9.9, 1.8, 0.9, 0.9, GREY),
            disc("stool 1", 2.7, 10.7, 0.19, 0.7, RED),
            disc("stool 2", 3.7, 10.7, 0.19, 0.7, RED),
            box("larder", 5.2, 11.65, 1.4, 0.56, 2.1, LINEN, texture=stripes(0.35, 0.3)),
            box("book row 1", 3.9, 13.4, 2.4, 0.36, 2.2, WALNUT, texture=stripes(0.3, 0.45)),
            box("book row 2", 0.33, 13.5, 0.34, 2.2, 2.2, WOOD, texture=stripes(0.25, 0.45)),
            box("book row 3", 4.2, 14.76, 2.6, 0.34, 2.2, OAK, texture=stripes(0.35, 0.45)),
            box("globe table", 1.7, 12.8, 0.6, 0.6, 0.9, BLUE, yaw=0.7),
            box("work table", 3.3, 16.7, 1.8, 0.9, 0.85, OAK, yaw=0.25),
            box("easel", 0.9, 17.1, 0.7, 0.4, 1.7, YELLOW, yaw=0.8),
            box("shelf", 3.4, 15.25, 1.8, 0.34, 1.8, STEEL, texture=stripes(0.4, 0.4)),
            box("paint cart", 5.5, 17.4, 0.6, 0.5, 0.8, RED),
        ],
        "starts": degrees(
            (5.6, 1.6, 90),
            (14.8, 4.2, 180),
            (7.0, 14.2, -90),
            (1.4, 4.2, 90),
            (10.9, 4.1, 180),
            (7.0, 5.9, -90),
            (4.8, 9.0, 0),
            (7.1, 9.6, -90),
            (7.2, 3.4, 180),
            (17.0, 4.3, 180),
        ),
        "goals": [
            [4.6, 12.7],
            [1.5, 3.7],
            [9.0, 2.2],
            [14.9, 2.6],
            [1.6, 11.6],
            [15.4, 7.0],
            [11.6, 2.6],
            [13.2, 6.2],
            [5.2, 16.4],
            [6.6, 7.2],
        ],
    }


def text(plan):
    """JSON with one entry a line, so that people can read it and differences stay small."""
    lines = ["{", '"format": "mannbv plan 1",']
    for key, value in plan.items():
        if isinstance(value, list):
            lines += [f'"{key}": [', ",\n".join("  " + json.dumps(entry) for entry in value), "],"]
        else:
            lines.append(f'"{key}": {json.dumps(value)},')
    return "\n".join(lines).rstrip(",") + "\n}\n"


def main(folder):
    for plan in (flat(), corridor(), openplan(), wings()):
        (Path(folder) / f"{plan['name']}.json").write_text(text(plan), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).resolve().parent)
