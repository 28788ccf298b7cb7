"""Algorithm 1: one planning cycle of a team, and the four strategies.

Observe → fit → plan → share → evaluate → agree → move. Each stage takes a robot's earlier values and what it received,
and returns a new record. Only share and agree communicate, always through `messages`.
"""

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import networkx as nx
import numpy as np
import torch

from mannbv import consensus, geometry, grid, information, mapping, messages, network, objective, planner, splats, world
from mannbv.camera import Camera, Frame, back_project
from mannbv.config import Config
from mannbv.mapping import LocalMap
from mannbv.objective import Belief
from mannbv.splats import SplatMap


@dataclass(frozen=True)
class Guests:
    """Splats received from teammates, keyed by sender (n,) and id (n,): never fitted, never passed on."""

    splats: SplatMap
    senders: torch.Tensor
    ids: torch.Tensor
    prior: torch.Tensor

    @staticmethod
    def none(dim: int) -> "Guests":
        nobody = torch.zeros(0, dtype=torch.int64)
        return Guests(SplatMap.empty(dim), nobody, nobody, torch.zeros(0, information.n_parameters(dim)))

    def _where(self, keep: torch.Tensor) -> "Guests":
        return Guests(self.splats.select(keep), self.senders[keep], self.ids[keep], self.prior[keep])

    def received(self, message: messages.Splats) -> "Guests":
        """With a teammate's splats: a whole map replaces all of its earlier ones, a part those with the same ids."""
        theirs = self.senders == message.robot
        stale = theirs if message.whole else theirs & torch.isin(self.ids, message.ids.long())
        kept = self._where(~stale)
        senders = torch.full((message.splats.n_splats,), message.robot)
        ids = message.ids.long()
        return Guests(
            splats.union(kept.splats, message.splats),
            torch.cat([kept.senders, senders]),
            torch.cat([kept.ids, ids]),
            torch.cat([kept.prior, message.prior]),
        )


@dataclass(frozen=True)
class Robot:
    """Everything one robot has: where it is, its private map, what it was sent, what it plans.

    position, goal (d,) [m]; yaw [rad]. frames: taken but not yet mapped. trail (k, d): where it has been [m].
    plans: the announced plans, by robot, its own included; none of robots at their goals. heard: teammates' grids
    (centralized only).
    status: "moving", "reached", or "stuck".
    """

    index: int
    position: np.ndarray
    yaw: float
    goal: np.ndarray
    local: LocalMap
    ground: grid.Occupancy
    guests: Guests
    trail: np.ndarray
    frames: tuple[Frame, ...] = ()
    heard: dict[int, grid.Occupancy] = field(default_factory=dict)
    plans: dict[int, messages.Plan] = field(default_factory=dict)
    route: planner.Route | None = None
    tried: tuple = ()
    status: str = "moving"
    stuck: int = 0
    collisions: int = 0

    def replace(self, **changes) -> "Robot":
        return dataclasses.replace(self, **changes)

    @property
    def announced(self) -> float:
        """The yaw that this robot would choose alone [rad]."""
        return self.plans[self.index].yaw if self.index in self.plans else self.yaw

    def belief(self) -> Belief:
        """What it may evaluate on: its own map and its guests, its own ground and the grids it was sent."""
        both = splats.union(self.local.splats, self.guests.splats)
        ground = self.ground.merged(*self.heard.values())
        return Belief(both, torch.cat([self.local.prior, self.guests.prior]), ground)


@dataclass(frozen=True)
class Mission:
    """What stays the same through an episode."""

    world: world.World
    camera: Camera
    config: Config
    network: nx.Graph
    strategy: str
    seed: int

    def rng(self, cycle: int, robot: int) -> np.random.Generator:
        """The generator of one robot in one cycle, so that a resumed run draws the same numbers."""
        return np.random.default_rng([self.seed, cycle, robot])


# ---- observe, fit, plan -------------------------------------------------------------------------------------------


def observe(robot: Robot, mission: Mission, cycle: int) -> Robot:
    """Map the frames taken on the last move, Eq. (2), and renew the information of all keyframes, Eqs. (3)-(5)."""
    local, config, camera = robot.local, mission.config, mission.camera
    noise = {"sigma_color": config.sigma_color, "sigma_depth": config.sigma_depth}
    rng = mission.rng(cycle, robot.index)
    for frame in robot.frames:
        local = mapping.observe(local, camera, frame, config, rng)
        if config.prior == "incremental":
            told = information.fisher(local.splats, camera, frame.pose, **noise)
            local = local.replace(prior=local.prior + told)
    if robot.frames and config.prior == "recompute":
        poses = [frame.pose for frame in local.keyframes]
        local = local.replace(prior=information.prior(local.splats, camera, poses, **noise))
    return robot.replace(local=local, frames=())


def plan(robot: Robot, mission: Mission, cycle: int) -> Robot:
    """A safe route towards the goal, and on it the next viewpoint with the yaw that is best for this robot alone."""
    config, camera = mission.config, mission.camera
    if robot.status == "reached":
        return robot.replace(route=None, plans={})
    belief = robot.belief()
    ground = belief.occupancy.cropped(np.stack([robot.position, robot.goal])[:, :2], 1.0)
    arguments = belief.splats, belief.prior, ground, camera, robot.position, robot.goal, config
    route = planner.plan(*arguments, tried=robot.tried) or planner.plan(*arguments)
    if route is None:
        here = messages.Plan(robot.index, cycle, robot.position, robot.yaw, robot.position[None])
        return robot.replace(route=None, stuck=robot.stuck + 1, status="stuck", plans={robot.index: here})
    place = route.ahead(config.stride)[-1]
    path = planner.thin(route.waypoints, 5 * config.cell)
    profile = objective.served(belief, camera, place, path, config)
    yaw = robot.yaw if profile is None else profile.best
    announced = messages.Plan(robot.index, cycle, place, yaw, path)
    return robot.replace(route=route, stuck=0, status="moving", plans={robot.index: announced})


# ---- share and evaluate: what a strategy replaces -----------------------------------------------------------------


def serve(robot: Robot, mission: Mission) -> np.ndarray:
    """F_i: gains (N, M) of every announced robot's view in this robot's map, Eqs. (23), (24); 0 for the unheard."""
    rows = np.zeros((len(mission.network), mission.config.n_yaws))
    known = sorted(robot.plans)
    positions = [np.asarray(robot.plans[k].position) for k in known]
    paths = [np.asarray(robot.plans[k].path) for k in known]
    rows[known] = objective.local(robot.belief(), mission.camera, positions, paths, mission.config)
    return rows


def serve_own(robot: Robot, mission: Mission) -> np.ndarray:
    """Only this robot's own view in what it holds: all of the objective that it can weigh alone."""
    return serve(robot.replace(plans={k: v for k, v in robot.plans.items() if k == robot.index}), mission)


def stay_silent(robots: list[Robot], mission: Mission, post: messages.Post, cycle: int) -> list[Robot]:
    """single: nothing is sent."""
    return robots


def share_plans(robots: list[Robot], mission: Mission, post: messages.Post, cycle: int) -> list[Robot]:
    """distributed: (T_i, P_i) to every teammate, relayed where the graph is not complete (Algorithm 1, line 5)."""
    return _flood(robots, [robot.plans.get(robot.index) for robot in robots], mission, post, cycle)


def share_guests(robots: list[Robot], mission: Mission, post: messages.Post, cycle: int) -> list[Robot]:
    """limited: plans as above, then every robot sends each teammate the splats in the view it suggests to it."""
    robots = share_plans(robots, mission, post, cycle)
    for robot in robots:
        gains = serve(robot, mission)
        for k in sorted(set(robot.plans) - {robot.index}):
            guests = view_cone(robot, mission, robot.plans[k].position, _best_yaw(gains[k]), cycle)
            post.relay(_way(mission, robot.index, k), guests, cycle)
    return [_receive(robot, post) for robot in robots]


def share_maps(robots: list[Robot], mission: Mission, post: messages.Post, cycle: int) -> list[Robot]:
    """centralized: plans, whole maps and grids to every teammate, so that each holds ⊔ G_i, Eq. (16)."""
    robots = share_plans(robots, mission, post, cycle)
    whole = [messages.Splats(r.index, cycle, r.local.splats, r.local.ids, r.local.prior, whole=1) for r in robots]
    robots = _flood(robots, whole, mission, post, cycle)
    return _flood(robots, [messages.Grid.of(r.index, cycle, r.ground) for r in robots], mission, post, cycle)


def view_cone(robot: Robot, mission: Mission, position: np.ndarray, yaw: float, cycle: int) -> messages.Splats:
    """This robot's splats in the view cone of a pose, the nearest first, at most `guest_splats`, with their prior."""
    camera, local = mission.camera, robot.local
    seen = geometry.yaw_pose(position, yaw).to(local.splats.means).local(local.splats.means)
    half = torch.tensor(camera.size) / 2 / camera.focal
    inside = (seen[:, -1] > 0) & (seen[:, :-1].abs() <= half * seen[:, -1:]).all(1)
    rows = torch.nonzero(inside)[:, 0]
    order = torch.argsort(torch.linalg.norm(seen[rows], dim=1), stable=True)
    rows = rows[order[: mission.config.guest_splats]]
    part = local.splats.select(rows)
    return messages.Splats(robot.index, cycle, part, local.ids[rows], local.prior[rows])


def _flood(robots: list[Robot], notes: list, mission: Mission, post: messages.Post, cycle: int) -> list[Robot]:
    """Every robot's note to all others, hop by hop; None where a robot has nothing to say."""
    for hop in network.hops(mission.network):
        for sender, receiver, origin in hop:
            if notes[origin] is not None:
                post.send(sender, receiver, notes[origin], cycle)
        robots = [_receive(robot, post) for robot in robots]
    return robots


def _way(mission: Mission, sender: int, receiver: int) -> list[int]:
    """The robots that a message for one teammate passes, both ends included."""
    return nx.shortest_path(mission.network, sender, receiver)


def _receive(robot: Robot, post: messages.Post) -> Robot:
    for _, message in post.collect(robot.index):
        if isinstance(message, messages.Plan):
            robot = robot.replace(plans={**robot.plans, message.robot: message})
        elif isinstance(message, messages.Splats):
            robot = robot.replace(guests=robot.guests.received(message))
        elif isinstance(message, messages.Grid):
            robot = robot.replace(heard={**robot.heard, message.robot: message.occupancy})
    return robot


class Strategy(NamedTuple):
    """share(robots, mission, post, cycle) → robots; evaluate(robot, mission) → gains (N, M); solver None: config's."""

    share: Callable
    evaluate: Callable
    solver: str | None


REGISTRY: dict[str, Strategy] = {
    "centralized": Strategy(share_maps, serve_own, "own"),  # (18) is separable: each takes its own best on ⊔ G_i
    "distributed": Strategy(share_plans, serve, None),
    "limited": Strategy(share_guests, serve, None),
    "single": Strategy(stay_silent, serve_own, "own"),
}
STRATEGIES = tuple(REGISTRY)


def register(name: str, share: Callable, evaluate: Callable, solver: str | None = None) -> None:
    """Add a strategy under a name that `episode.run` and the command line then understand (see `Strategy`).

    Raises ValueError if the name is one of the paper's four.
    """
    if name in STRATEGIES:
        raise ValueError(f"team: '{name}' is one of the paper's strategies; choose another name")
    REGISTRY[name] = Strategy(share, evaluate, solver)


# ---- agree --------------------------------------------------------------------------------------------------------


def agree(robots: list[Robot], gains: np.ndarray, mission: Mission, post: messages.Post, cycle: int, solver: str):
    """Everyone's yaw (N,) [rad] from the stacked F_i (N, N, M), and the largest residual of each round.

    C-ADMM and the profile exchange really send their messages; any other solver is handed the tables.
    The scale of the gains is agreed first (one number a robot). A real team would run all T_ADMM rounds or spend one
    bit a message on stopping; here the rounds end when every robot's residuals are below the tolerance.
    """
    config = mission.config
    announced = np.array([robot.announced for robot in robots])
    scale = consensus.scale_of(gains)
    settings = {
        "penalty": config.penalty,
        "growth": config.penalty_growth,
        "rounds": config.rounds,
        "tolerance": config.tolerance,
        "scale": scale,
    }
    if not solver.startswith("cadmm"):
        if solver == "profile":
            _send_profiles(gains, mission, post, cycle)
        return consensus.solve(gains, mission.network, announced, solver, **settings)[-1].yaws, []
    states = [
        consensus.start(
            i, network.neighbours(mission.network, i), announced, gains[i], penalty=config.penalty,
            growth=config.penalty_growth, scale=scale, circle=solver != "cadmm-literal",
            primal="gradient" if solver == "cadmm-gradient" else "exact",
        )
        for i in range(len(robots))
    ]  # fmt: skip
    residuals = []
    for turn in range(config.rounds):
        for state in states:
            for j in state.neighbours:
                post.send(state.robot, j, messages.Copies(state.robot, cycle, turn, state.copies), cycle)
        inboxes = [{sender: m.offsets for sender, m in post.collect(state.robot)} for state in states]
        states = [consensus.step(state, inbox) for state, inbox in zip(states, inboxes, strict=True)]
        residuals.append(max(max(state.primal_residual, state.dual_residual) for state in states))
        if residuals[-1] < config.tolerance:
            break
    return np.array([state.yaw for state in states]), residuals


def _send_profiles(gains: np.ndarray, mission: Mission, post: messages.Post, cycle: int) -> None:
    for i, row in enumerate(gains):
        for k in range(len(gains)):
            if k != i:
                levels, height = consensus.quantise(row[k])
                post.relay(_way(mission, i, k), messages.Profile(i, cycle, k, height, levels), cycle)
                post.collect(k)


def suggest(robots: list[Robot], gains: np.ndarray, mission: Mission, post: messages.Post, cycle: int) -> list:
    """Everyone's best view for every teammate, argmax f_ik, sent to it (Fig. 2b): rows of (from, for, yaw, gain)."""
    rows = []
    for robot in robots:
        largest = float(gains[robot.index].max())
        for k in sorted(set(robot.plans) - {robot.index}):
            row, yaw = gains[robot.index, k], _best_yaw(gains[robot.index, k])
            if row.max() > 0:
                at_announced = consensus.interpolate(row, robot.plans[k].yaw)
                note = messages.Suggestion(robot.index, cycle, k, yaw, float(row.max()), float(at_announced), largest)
                post.relay(_way(mission, robot.index, k), note, cycle)
                rows.append([robot.index, k, yaw, float(row.max())])
    for robot in robots:
        post.collect(robot.index)
    return rows


def _best_yaw(gains: np.ndarray) -> float:
    return float(information.uniform_yaws(len(gains))[int(np.argmax(gains))])


# ---- move ---------------------------------------------------------------------------------------------------------


def start(index: int, position: np.ndarray, yaw: float, goal: np.ndarray, mission: Mission) -> Robot:
    """A robot with an empty map that has looked once around and kept a frame each field of view."""
    dim = mission.world.dim
    ground = grid.Occupancy.unknown(mission.world.lattice(mission.config.cell))
    local = LocalMap.empty(dim, information.n_parameters(dim))
    robot = Robot(index, position, yaw, goal, local, ground, Guests.none(dim), position[None])
    steps = round(2 * math.pi / mission.config.turn)
    every, rng = max(1, int(mission.config.fov / mission.config.turn)), mission.rng(0, index)
    for turn in range(steps):
        frame, robot = look(robot.replace(yaw=geometry.wrap(yaw + turn * mission.config.turn)), mission, rng)
        if turn % every == 0:
            robot = robot.replace(frames=(*robot.frames, frame))
    return robot.replace(yaw=yaw)


def look(robot: Robot, mission: Mission, rng: np.random.Generator) -> tuple[Frame, Robot]:
    """Take a frame and carve the ground that it shows free."""
    config = mission.config
    pose = geometry.yaw_pose(torch.from_numpy(robot.position), robot.yaw)
    frame = mission.world.sense(mission.camera, pose, config.max_depth, config.depth_noise, config.color_noise, rng)
    valid = frame.valid.reshape(-1)
    depth = torch.where(valid, frame.depth.reshape(-1), config.max_depth / math.sqrt(2))
    ends = back_project(Frame(frame.color, depth, pose), mission.camera).numpy()
    return frame, robot.replace(ground=robot.ground.carved(robot.position, ends, valid.numpy()))


def move(robot: Robot, yaw: float, mission: Mission, cycle: int) -> Robot:
    """Follow the route to the viewpoint by steps and turns, looking all the way, then turn to the chosen yaw.

    Two frames are kept for the map: on arrival, facing ahead (at a frontier: facing it), and the chosen view.
    The robot stops short where a surface it has just seen comes nearer than its radius.
    """
    config, rng = mission.config, mission.rng(cycle, 1000 + robot.index)
    if robot.status == "reached":
        return robot
    frame = None
    if robot.route is not None:
        path = robot.route.ahead(config.stride)
        for position, heading in world.follow(robot.position, robot.yaw, path, config.step, config.turn):
            if np.array_equal(position, robot.position):
                robot = robot.replace(yaw=heading)
            elif not _fits(position, robot.ground, config):
                break
            else:
                clear = float(mission.world.clearance(position[None])[0])
                robot = robot.replace(
                    position=position, yaw=heading, trail=np.concatenate([robot.trail, position[None]]),
                    collisions=robot.collisions + int(clear < config.robot_radius),
                )  # fmt: skip
            frame, robot = look(robot, mission, rng)
        if robot.route.look is not None and len(path) == len(robot.route.waypoints):
            away = robot.route.look - robot.position
            frame, robot = _turn(robot, math.atan2(away[1], away[0]), mission, rng)
            robot = robot.replace(tried=(*robot.tried, path[-1][:2]))
    kept = () if frame is None else (frame,)
    frame, robot = _turn(robot, yaw, mission, rng)
    status = "reached" if np.linalg.norm(robot.position - robot.goal) <= config.reach else robot.status
    return robot.replace(frames=(*kept, frame), status=status)


def _turn(robot: Robot, yaw: float, mission: Mission, rng: np.random.Generator) -> tuple[Frame, Robot]:
    frame, robot = look(robot, mission, rng)
    for heading in world.turn_to(robot.yaw, yaw, mission.config.turn):
        frame, robot = look(robot.replace(yaw=heading), mission, rng)
    return frame, robot


def _fits(position: np.ndarray, ground: grid.Occupancy, config: Config) -> bool:
    """Whether no known surface is nearer than the robot's radius and half a cell."""
    reach = config.robot_radius + 0.5 * config.cell
    offsets = np.arange(-math.ceil(reach / config.cell), math.ceil(reach / config.cell) + 1)
    cells = ground.lattice.index(position[None])[0] + np.stack(np.meshgrid(offsets, offsets), -1).reshape(-1, 2)
    cells = cells[ground.lattice.inside(cells)]
    occupied = cells[ground.log_odds[cells[:, 0], cells[:, 1]] > 0]
    away = np.linalg.norm(ground.lattice.centers(occupied) - position[:2], axis=1)
    return bool((away >= reach).all())


# ---- the cycle ----------------------------------------------------------------------------------------------------


def cycle(robots: list[Robot], mission: Mission, post: messages.Post, number: int) -> tuple[list[Robot], dict]:
    """One planning cycle of the whole team (Algorithm 1): the robots after it, and a plain record of what happened."""
    strategy, clock = REGISTRY[mission.strategy], _Clock()
    robots = [observe(robot, mission, number) for robot in robots]
    clock.mark("map")
    robots = [plan(robot, mission, number) for robot in robots]
    clock.mark("plan")
    robots = strategy.share(robots, mission, post, number)
    clock.mark("share")
    gains = np.stack([strategy.evaluate(robot, mission) for robot in robots])
    clock.mark("evaluate")
    suggestions = suggest(robots, gains, mission, post, number)
    solver = strategy.solver or mission.config.solver
    yaws, residuals = agree(robots, gains, mission, post, number, solver)
    clock.mark("agree")
    report = {
        "cycle": number,
        "robots": [_describe(robot, yaw) for robot, yaw in zip(robots, yaws, strict=True)],
        "suggestions": suggestions,
        "residuals": residuals,
        "team_gain": objective.team(gains, yaws),
        "best_gain": float(gains.sum(0).max(1).sum()),
        "own_gain": objective.team(gains, np.array([robot.announced for robot in robots])),
    }
    robots = [move(robot, float(yaw), mission, number) for robot, yaw in zip(robots, yaws, strict=True)]
    clock.mark("move")
    return robots, report | {"seconds": clock.spent}


def _describe(robot: Robot, yaw: float) -> dict:
    view = robot.plans.get(robot.index)
    return {
        "position": robot.position.tolist(),
        "yaw": robot.yaw,
        "status": robot.status,
        "splats": robot.local.splats.n_splats,
        "guests": robot.guests.splats.n_splats,
        "view": None if view is None else view.position.tolist(),
        "announced": robot.announced,
        "chosen": float(yaw),
        "path": [] if view is None else view.path.tolist(),
        "subgoals": [] if robot.route is None else robot.route.candidates.tolist(),
    }


class _Clock:
    """Seconds spent in each stage."""

    def __init__(self):
        self.spent, self._last = {}, time.perf_counter()

    def mark(self, stage: str) -> None:
        now = time.perf_counter()
        self.spent[stage], self._last = now - self._last, now
