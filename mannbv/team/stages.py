"""What one robot does alone in a cycle: observe, fit and plan at its beginning, move at its end."""

import math

import numpy as np
import torch

from mannbv import geometry, grid, information, mapping, messages, objective, planner, world
from mannbv.camera import Camera, Frame, back_project
from mannbv.config import Config
from mannbv.mapping import LocalMap
from mannbv.team.robots import Guests, Mission, Robot


def observe(robot: Robot, mission: Mission, cycle: int) -> Robot:
    """Map the frames taken on the last move, Eq. (2), and renew the information of all keyframes, Eqs. (3)-(5)."""
    local, config, camera, guests = robot.local, mission.config, mission.camera, robot.guests
    rng = mission.rng(cycle, robot.index)
    for frame in robot.frames:
        local = mapping.observe(local, camera, frame, config, rng)
        if config.prior == "incremental":
            shown = information.fisher(local.splats, camera, frame.pose, **config.noise)
            local = local.replace(prior=local.prior + shown)
    if robot.frames and config.prior == "recompute":
        poses = [frame.pose for frame in local.keyframes]
        local = local.replace(prior=information.prior(local.splats, camera, poses, **config.noise))
    guests = guests.seen_in(robot.frames, local.splats, camera, config)
    return robot.replace(cycle=cycle, local=local, guests=guests, frames=())


def meet(robot: Robot, mission: Mission) -> Robot:
    """Look up in the own keyframes what they tell of splats that have just been received."""
    guests = robot.guests.met(robot.local.splats, mission.camera, robot.local.keyframes, mission.config)
    return robot.replace(guests=guests)


def plan(robot: Robot, mission: Mission) -> Robot:
    """A safe route towards the goal, and on it the next viewpoint with the yaw that is best for this robot alone."""
    config, camera = mission.config, mission.camera
    if robot.status == "reached":
        return robot.replace(route=None, plans={})
    belief = robot.belief(config)
    arguments = belief, camera, robot.position, robot.goal, config
    route = planner.plan(*arguments, tried=robot.tried) or planner.plan(*arguments)
    if route is None:
        here = messages.Plan(robot.index, robot.cycle, robot.position, robot.yaw, robot.position[None])
        return robot.replace(route=None, stuck=robot.stuck + 1, status="stuck", plans={robot.index: here})
    place = route.ahead(config.stride)[-1]
    path = planner.thin(route.waypoints, config.path_spacing)
    profile = objective.served(belief, camera, place, path, config)
    yaw = robot.yaw if profile is None else profile.best
    announced = messages.Plan(robot.index, robot.cycle, place, yaw, path)
    return robot.replace(route=route, stuck=0, status="moving", plans={robot.index: announced})


def start(index: int, position: np.ndarray, yaw: float, goal: np.ndarray, mission: Mission) -> Robot:
    """A robot with an empty map that has looked once around and kept a frame each field of view."""
    dim = mission.world.dim
    ground = grid.Occupancy.unknown(mission.world.ground.lattice(mission.config.cell))
    local = LocalMap.empty(dim, information.n_parameters(dim))
    robot = Robot(index, position, yaw, goal, local, ground, Guests.none(dim), position[None])
    steps = round(2 * math.pi / mission.config.turn)
    every, rng = max(1, int(mission.config.fov / mission.config.turn)), mission.rng(0, index)
    for turn in range(steps):
        robot = look(robot.replace(yaw=geometry.wrap(yaw + turn * mission.config.turn)), mission, rng)
        if turn % every == 0:
            robot = robot.replace(frames=(*robot.frames, take(robot, mission.camera, mission, rng)))
    return robot.replace(yaw=yaw)


def take(robot: Robot, camera: Camera, mission: Mission, rng: np.random.Generator) -> Frame:
    """What the robot sees where it stands."""
    config, pose = mission.config, geometry.yaw_pose(torch.from_numpy(robot.position), robot.yaw)
    return mission.world.sense(camera, pose, config.max_depth, config.depth_noise, config.color_noise, rng)


def look(robot: Robot, mission: Mission, rng: np.random.Generator) -> Robot:
    """Carve the ground that a look shows free; in 3-D, of what stands in the height of the robot's body."""
    config, scout = mission.config, mission.scout
    frame = take(robot, scout, mission, rng)
    valid = frame.valid.reshape(-1)
    # where nothing is in range the way is free; how far is told cautiously
    depth = torch.where(valid, frame.depth.reshape(-1), config.max_depth * config.free_share)
    ends = back_project(Frame(frame.color, depth, frame.pose), scout).numpy()
    floor = robot.position[2:] - config.camera_height
    body = *(floor + config.body_low), *(floor + config.body_high)  # nothing in flatland
    carved = robot.ground.carved_around if body else robot.ground.carved
    return robot.replace(ground=carved(robot.position, ends, valid.numpy(), *body, config=config))


def move(robot: Robot, mission: Mission, yaw: float | None = None) -> Robot:
    """Follow the route to the viewpoint by steps and turns, looking all the way, then turn to the chosen yaw [rad].

    Two frames are kept for the map: on arrival, facing ahead (at a frontier: facing it), and the chosen view.
    The robot stops short where a surface it has just seen comes nearer than its radius.
    """
    config, rng = mission.config, mission.rng(robot.cycle, 1000 + robot.index)
    if yaw is None:
        yaw = robot.deciding.yaw
    if robot.status == "reached":
        return robot.replace(choice=None)
    arrived = False
    route = robot.route
    if route is not None:
        path = route.ahead(config.stride)
        for spot, heading in world.follow(robot.position, robot.yaw, path, config.step, config.turn):
            position = np.concatenate([spot, robot.position[2:]])
            if np.array_equal(position, robot.position):
                robot = robot.replace(yaw=heading)
            elif not _fits(position, robot.ground, config):
                break
            else:
                clear = float(mission.world.ground.clearance(position[None])[0])
                robot = robot.replace(
                    position=position, yaw=heading, trail=np.concatenate([robot.trail, position[None]]),
                    collisions=robot.collisions + int(clear < config.robot_radius),
                )  # fmt: skip
            robot, arrived = look(robot, mission, rng), True
        if route.look is not None and len(path) == len(route.waypoints):
            away = route.look - robot.position
            robot = _turn(robot, math.atan2(away[1], away[0]), mission, rng)
            robot, arrived = robot.replace(tried=(*robot.tried, path[-1][:2])), True
    kept = (take(robot, mission.camera, mission, rng),) if arrived else ()
    robot = _turn(robot, yaw, mission, rng)
    frame = take(robot, mission.camera, mission, rng)
    status = "reached" if np.linalg.norm(robot.position - robot.goal) <= config.reach else robot.status
    return robot.replace(frames=(*kept, frame), status=status, choice=None)


def _turn(robot: Robot, yaw: float, mission: Mission, rng: np.random.Generator) -> Robot:
    robot = look(robot, mission, rng)
    for heading in world.turn_to(robot.yaw, yaw, mission.config.turn):
        robot = look(robot.replace(yaw=heading), mission, rng)
    return robot


def _fits(position: np.ndarray, ground: grid.Occupancy, config: Config) -> bool:
    """Whether no known surface is nearer than the robot's radius and half a cell."""
    reach = config.robot_radius + 0.5 * config.cell
    offsets = np.arange(-math.ceil(reach / config.cell), math.ceil(reach / config.cell) + 1)
    cells = ground.lattice.index(position[None])[0] + np.stack(np.meshgrid(offsets, offsets), -1).reshape(-1, 2)
    cells = cells[ground.lattice.inside(cells)]
    occupied = cells[ground.log_odds[cells[:, 0], cells[:, 1]] > 0]
    away = np.linalg.norm(ground.lattice.centers(occupied) - position[:2], axis=1)
    return bool((away >= reach).all())
