"""What is timed, and against what: each stage yields its results, those of one group taken in turns.

Before rivals are timed their answers are compared with ours.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from torch import Tensor

from mannbv import geometry, information, mapping, render, risk, world
from mannbv.camera import Camera, Frame
from mannbv.config import Config
from mannbv.kernels.space import blend, projection
from mannbv.kernels.space.tiles import TILE
from mannbv.lab.bench import fresh, rivals, scenes
from mannbv.lab.bench.calls import whole_calls
from mannbv.lab.bench.sides import Scale, Side, agree, compare
from mannbv.lab.bench.timing import Result, most_threads, threads
from mannbv.render import space
from mannbv.render.limits import CUTOFF, FLOOR
from mannbv.splats import SplatMap

STEPS = 30 * 5  # gradient steps that a yaw profile replaces: rounds of agreement times steps of a primal update
WHOLE = ("forward", "backward", "fisher")
_CALLED = ("forward", "forward and gradient", "Fisher, its forward pass included")


def _size(n_splats: int, size: int, dim: int) -> str:
    return f"{n_splats:,} splats, {'×'.join([str(size)] * (dim - 1))} px"


def _whole_sides(name: str, size: tuple[int, int], method: str = "auto", by: str = "") -> list[Side]:
    calls = zip(WHOLE, _CALLED, whole_calls(*size, method), strict=True)
    return [Side(f"{name}.{key}", f"{called}; {_size(*size, 3)}{by}", call) for key, called, call in calls]


def whole(scale: Scale) -> Iterator[Result]:
    """Space at the paper's size and at the quick one."""
    for name in ("large", "small"):
        n_splats, size = getattr(scale, name)
        yield from compare(_whole_sides(name, (n_splats, size)), scale, None, "forward", splats=n_splats, width=size)


def pairs(scale: Scale) -> Iterator[Result]:
    """Nanoseconds of one core for each pixel that a splat is evaluated at: the kernels alone, on one thread."""
    room, (camera, pose) = scenes.room(scale.large[0], 3), scenes.view(scale.large[1], 3)
    seen = space.sort(room, camera, pose, CUTOFF)
    values = np.concatenate(
        [room.colors.numpy()[seen.index], seen.splats[:, projection.DEPTH : projection.DEPTH + 1]], 1
    )
    common, floor = (seen.splats, values, seen.pairs, seen.tiles), np.float32(FLOOR)
    image, full, spans = blend.composite(*common, seen.order, camera.width, camera.height, floor)
    needed = np.arange(len(seen.pairs)) < np.repeat(full, np.diff(seen.tiles))
    evaluated = int((spans[needed, 1].astype(int) - spans[needed, 0]).sum()) * TILE
    counts, slopes = np.ones(len(seen.index), bool), np.ones_like(image)
    calls = [
        lambda: blend.composite(*common, seen.order, camera.width, camera.height, floor),
        lambda: blend.backward(*common, full, spans, seen.order, image, slopes, floor),
        lambda: blend.moments(*common, full, spans, seen.order, image, counts, floor),
    ]
    titles = ("forward", "backward alone", "Fisher alone")
    sides = [
        Side(f"pair.{key}", f"{title}, CPU time of one core for a pixel and a splat", call)
        for key, title, call in zip(WHOLE, titles, calls, strict=True)
    ]
    for result in compare(sides, scale, 1, splats=scale.large[0], width=scale.large[1], pairs=evaluated):
        spent = tuple(1e9 * taken / evaluated for taken in result.cpu)
        yield replace(result, unit="ns", samples=spent, cpu=(), beside="forward")


def dense(scale: Scale) -> Iterator[Result]:
    """Against the dense twin, which evaluates every splat at every pixel."""
    ours = _whole_sides("dense.ours", scale.dense, by=", kernel")
    twins = _whole_sides("dense.twin", scale.dense, "dense", by=", dense twin")
    for side, twin in zip(ours, twins, strict=True):
        apart = agree(side.title, _flat(side.call()), _flat(twin.call()))
        yield from compare([side, twin], scale, 1, splats=scale.dense[0], width=scale.dense[1], apart=apart)


def _flat(answer) -> Tensor:
    """An image, gradients or information as one vector."""
    parts = [answer.color, answer.depth, answer.opacity] if isinstance(answer, render.Rendering) else answer
    return torch.cat([part.reshape(-1) for part in parts])


def fisher(scale: Scale) -> Iterator[Result]:
    """Exact information: ours, its dense twin, and what autograd makes of it, in both dimensions."""
    groups = (
        ("gram", 3, scale.gram, ()),
        ("gram.one", 3, scale.gram, ("twin",)),
        ("loop.one", 3, scale.loop, ("loop", "jacrev")),
        ("flat", 2, scale.flat, ()),
        ("flat.one", 2, scale.flat, ("twin",)),
        ("flatloop.one", 2, scale.flat, ("loop", "jacrev")),
    )
    for name, dim, (n_splats, size), others in groups:
        room, (camera, pose) = scenes.room(n_splats, dim), scenes.view(size, dim)
        view, what = (room, camera, pose), f"exact Fisher; {_size(n_splats, size, dim)}"
        sides, apart = [Side(f"{name}.fisher", what, partial(information.fisher, *view))], {}
        for key in others:
            title, rival, shown = _RIVALS[key]
            sides.append(Side(f"{name}.fisher.{key}", f"{what}; {title}", partial(rival, *view)))
            ours, theirs = (shown(side.call(), dim) for side in (sides[0], sides[-1]))
            apart[f"apart_{key}"] = agree(f"{what}: ours and {title}", ours, theirs)
        yield from compare(sides, scale, 1 if others else None, splats=n_splats, width=size, **apart)


_RIVALS = {
    "twin": ("dense twin", partial(information.fisher, method="dense"), lambda rows, dim: rows),
    "loop": ("a backward pass for each channel of each pixel", rivals.looped_fisher, rivals.without_turn),
    "jacrev": ("torch.func.jacrev", rivals.jacrev_fisher, rivals.without_turn),
}


def profile(scale: Scale) -> Iterator[Result]:
    """All yaws from one look around, against gradient steps on renderings: one step is timed, and taken STEPS times."""
    for name, dim, (n_splats, size) in (("flat", 2, scale.flat), ("space", 3, scale.profile)):
        room, (camera, pose) = scenes.room(n_splats, dim), scenes.view(size, dim)
        prior, what = information.prior(room, camera, [pose]), _size(n_splats, size, dim)

        def step(yaw: float, room=room, camera=camera, pose=pose, prior=prior):
            view = geometry.yaw_pose(pose.position, yaw)
            return information.gain(information.fisher(room, camera, view), prior)

        ours = partial(information.yaw_profile, room, camera, pose.position, prior)
        found = ours()
        some = range(0, len(found.yaws), max(1, len(found.yaws) // 8))
        views = torch.stack([step(found.yaws[k]) for k in some]).double()
        apart = agree(f"gains; {what}: profile and views", torch.from_numpy(found.gains[list(some)]), views)
        with_slope = partial(information.gain_and_slope, room, camera, pose.position, scenes.YAW, prior)
        sides = [
            Side(f"{name}.profile", f"profile of {len(found.yaws)} yaws; {what}", ours),
            Side(f"{name}.steps", f"{STEPS} Fisher passes; {what}", partial(step, scenes.YAW), STEPS),
            Side(f"{name}.slopes", f"{STEPS} Fisher passes and their slopes by autograd; {what}", with_slope, STEPS),
        ]
        # in space autograd goes through the dense twin, which holds every splat at every pixel
        yield from compare(sides[: 5 - dim], scale, 1, splats=n_splats, width=size, apart=apart)


def risk_field(scale: Scale) -> Iterator[Result]:
    """The risk field, against all distances."""
    n_splats, n_points = scale.field
    room, level = scenes.room(n_splats, 2), 0.1
    points = torch.from_numpy(np.random.default_rng(1).uniform(0, 6, (n_points, 2)).astype(np.float32))
    what = f"risk field; {n_splats:,} splats, {n_points:,} points"
    factor = -float(risk.average_value_at_risk(0.0, 1.0, level))
    ours, theirs = partial(risk.field, room, points, level), partial(rivals.risk_field, room, points, factor)
    sides = [Side("field", what, ours), Side("field.distances", f"{what}; all distances in torch", theirs)]
    apart = agree(what, ours(), theirs())
    yield from compare(sides, scale, 1, splats=n_splats, points=n_points, apart=apart)


def keyframes(scale: Scale) -> Iterator[Result]:
    """One more keyframe for a map in space that holds about a splat a pixel: insert, fit, prune."""
    n_splats, size = scale.small
    room, (camera, pose), config = scenes.room(n_splats, 3), scenes.view(size, 3), Config()
    frames = [_taken(room, camera, geometry.yaw_pose(pose.position, scenes.YAW + turned)) for turned in (0.0, 0.2)]
    empty = mapping.LocalMap.empty(3, information.n_parameters(3))
    before = mapping.observe(empty, camera, frames[0], config, np.random.default_rng(0))

    def observe():
        return mapping.observe(before, camera, frames[1], config, np.random.default_rng(0))

    held = observe().splats.n_splats
    side = Side("keyframe", f"a keyframe's mapping; {_size(held, size, 3)}", observe)
    yield from compare([side], scale, splats=held, width=size)


def _taken(room: SplatMap, camera, pose) -> Frame:
    """A frame of the room; no depth where it is half transparent."""
    with torch.no_grad():
        drawn = render.render(room, camera, pose)
    return Frame(drawn.color, torch.where(drawn.opacity > 0.5, drawn.depth / drawn.opacity, 0.0), pose)


def sensing(scale: Scale) -> Iterator[Result]:
    """A frame of RGB-D of the largest bundled building."""
    place = world.load("wings", dim=3)
    pose = geometry.yaw_pose(torch.from_numpy(place.starts[0, :3]), place.starts[0, 3])
    assert isinstance(place.seen, world.Surfaces)
    what = f"a frame of RGB-D; {len(place.seen.corners):,} triangles"
    for name, size in (("large", scale.large[1]), ("small", scale.small[1])):
        camera = Camera.from_fov(size, size)
        side = Side(f"sense.{name}", f"{what}, {size}×{size} px", partial(place.sense, camera, pose))
        yield from compare([side], scale, width=size)


def curves(scale: Scale) -> Iterator[Result]:
    """Cost on one thread against splats at the large image and pixels with the large map; on both against threads."""
    n_splats, size = scale.large
    counts = [1]
    while counts[-1] < most_threads():
        counts.append(min(2 * counts[-1], most_threads()))
    yield from _curve("splats", [(n, (n, size)) for n in scale.splats], scale)
    yield from _curve("pixels", [(side * side, (n_splats, side)) for side in scale.sides], scale)
    yield from _curve("threads", [(count, scale.large) for count in counts], scale)


def _curve(over: str, points: list[tuple[int, tuple[int, int]]], scale: Scale) -> Iterator[Result]:
    sides = []
    for at, size in points:
        by = "" if over != "threads" else f", {at} thread{'s' if at > 1 else ''}"
        for stage, side in zip(WHOLE, _whole_sides(f"{over}.{at}", size, by=by), strict=True):
            call = side.call if over != "threads" else partial(_on, at, side.call)
            place = {"over": over, "at": at, "stage": stage, "splats": size[0], "width": size[1]}
            sides.append(replace(side, call=call, facts=place))
    for result in compare(sides, scale, None if over == "threads" else 1):
        yield replace(result, ratio=(), threads=result.facts["at"] if over == "threads" else 1)


def _on(count: int, call: Callable[[], object]) -> object:
    with threads(count):
        return call()


def alone(scale: Scale) -> Iterator[Result]:
    """What needs processes of its own."""
    yield from fresh.first(scale.fresh, scale.cold)
    yield from fresh.memory(*scale.memory)
    if scale.job:
        yield from fresh.job()


STAGES = {
    "whole calls": whole,
    "pairs": pairs,
    "dense twin": dense,
    "Fisher": fisher,
    "profiles": profile,
    "risk field": risk_field,
    "keyframes": keyframes,
    "sensing": sensing,
    "curves": curves,
    "fresh processes": alone,
}
