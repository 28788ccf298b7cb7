"""Algorithm 1 and the four strategies: who hears what, what it weighs in bytes, and users' own strategies."""

import dataclasses
import math

import networkx as nx
import numpy as np
import pytest
import torch
from helpers import random_map

from mannbv import consensus, episode, grid, information, messages, network, risk, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.mapping import LocalMap

SMALL = Config(image_width=32, fit_steps=4, max_cycles=2, n_yaws=72, rounds=6, n_subgoals=2)


@pytest.fixture(scope="module")
def place():
    return episode.draw_team(world.load("flat"), 3, 0, SMALL)


def mission_for(place, strategy, config=SMALL, graph="complete", n=3, seed=0) -> team.Mission:
    camera = Camera.of_dim(place.dim, config.image_width, config.image_height, config.fov)
    return team.Mission(place, camera, config, network.build(graph, n), strategy, seed)


@pytest.fixture(scope="module")
def crew(place):
    """Three robots that have looked around, mapped and planned, but not talked."""
    mission = mission_for(place, "distributed")
    robots = [
        team.start(k, place.starts[k, :-1], float(place.starts[k, -1]), place.goals[k], mission) for k in range(3)
    ]
    return [team.plan(team.observe(robot, mission, 0), mission, 0) for robot in robots]


def after(crew, place, strategy, config=SMALL, graph="complete"):
    mission, post = mission_for(place, strategy, config, graph), messages.Mailbox(config.codec)
    robots = team.REGISTRY[strategy].share(list(crew), mission, post, 0)
    return robots, mission, post


def test_single_robots_say_nothing_and_weigh_only_their_own_view(crew, place):
    robots, mission, post = after(crew, place, "single")
    gains = np.stack([team.REGISTRY["single"].evaluate(robot, mission) for robot in robots])
    assert post.ledger.total() == 0
    assert (gains[~np.eye(3, dtype=bool)] == 0).all()
    assert (gains[np.eye(3, dtype=bool)].max(1) > 0).all()


def test_distributed_robots_hear_every_plan_and_never_a_splat(crew, place):
    robots, mission, post = after(crew, place, "distributed")
    assert all(sorted(robot.plans) == [0, 1, 2] for robot in robots)
    assert all(robot.guests.splats.n_splats == 0 and not robot.heard for robot in robots)
    gains = np.stack([team.serve(robot, mission) for robot in robots])
    team.suggest(robots, gains, mission, post, 0)
    team.agree(robots, gains, mission, post, 0, "cadmm")
    assert set(post.ledger.by_kind()) == {"Plan", "Suggestion", "Copies"}


def test_limited_robots_hold_guests_that_they_neither_fit_nor_pass_on(crew, place):
    config = SMALL.replace(guest_splats=7)
    robots, _, post = after(crew, place, "limited", config)
    for robot, before in zip(robots, crew, strict=True):
        assert robot.local is before.local
        senders = robot.guests.senders.tolist()
        assert robot.index not in senders
        assert all(senders.count(k) <= 7 for k in range(3))
        for row, (sender, number) in enumerate(zip(senders, robot.guests.ids.tolist(), strict=True)):
            theirs = crew[sender].local
            same = int(torch.nonzero(theirs.ids == number)[0, 0])
            assert torch.equal(robot.guests.splats.means[row], theirs.splats.means[same])
            assert torch.equal(robot.guests.prior[row], theirs.prior[same])
    assert sum(robot.guests.splats.n_splats for robot in robots) > 0
    assert post.ledger.by_kind()["Splats"] > 0
    # a second exchange of the same splats replaces them
    again, _, _ = after(robots, place, "limited", config)
    assert [r.guests.splats.n_splats for r in again] == [r.guests.splats.n_splats for r in robots]


def test_centralized_robots_hold_the_union_of_all_maps_and_grids(crew, place):
    robots, _, _ = after(crew, place, "centralized")
    everyone = sorted(map(tuple, torch.cat([r.local.splats.means for r in crew]).tolist()))
    for robot in robots:
        belief = robot.belief()
        assert sorted(map(tuple, belief.splats.means.tolist())) == everyone
        seen = np.stack([r.ground.state != grid.UNKNOWN for r in crew]).any(0)
        centers = place.ground.lattice(SMALL.cell).centers().reshape(-1, 2)
        known = belief.occupancy.lattice.at(belief.occupancy.state, centers, grid.UNKNOWN) != grid.UNKNOWN
        assert (known == seen.ravel()).all()
    smaller = crew[0].local.splats.select(torch.arange(5))
    fewer = crew[0].replace(
        local=LocalMap(smaller, crew[0].local.ids[:5], crew[0].local.prior[:5], crew[0].local.keyframes)
    )
    later, _, _ = after([fewer, *robots[1:]], place, "centralized")
    assert int((later[1].guests.senders == 0).sum()) == 5  # a whole map replaces the one before


@pytest.mark.parametrize("strategy", ["centralized", "limited"])
def test_splats_wider_than_the_share_scale_stay_at_home(crew, place, strategy):
    widths = torch.cat([robot.local.splats.scales.amax(1) for robot in crew])
    limit = float(widths.median())
    robots, _, _ = after(crew, place, strategy, SMALL.replace(share_scale=limit))
    without, _, _ = after(crew, place, strategy)
    sent, all_ = (torch.cat([r.guests.splats.scales.amax(1) for r in team_]) for team_ in (robots, without))
    assert 0 < len(sent) < len(all_)
    assert sent.max() <= limit < all_.max()
    assert all(robot.local is before.local for robot, before in zip(robots, crew, strict=True))
    if strategy == "centralized":
        assert sum(r.guests.splats.n_splats for r in robots) == 2 * int((widths <= limit).sum())


@pytest.mark.parametrize("graph", ["ring", "line", "star"])
def test_plans_reach_everyone_over_any_connected_graph_and_only_over_its_links(crew, place, graph):
    robots, mission, post = after(crew, place, "distributed", graph=graph)
    assert all(sorted(robot.plans) == [0, 1, 2] for robot in robots)
    assert {tuple(sorted(link)) for link in post.ledger.by_link()} <= {tuple(sorted(e)) for e in mission.network.edges}


def synthetic(index: int, n: int, place, plans) -> team.Robot:
    """A robot with a made-up map of n splats over the whole flat."""
    rng = np.random.default_rng(index)
    lower, upper = place.seen.lower, place.seen.upper
    centre, half = (lower + upper) / 2, (upper - lower) / 2
    splats = random_map(rng, n, 2, torch.float32, reach=1.0)
    splats = dataclasses.replace(splats, means=splats.means * torch.tensor(half) + torch.tensor(centre)).to(
        torch.float32
    )
    local = LocalMap(splats, torch.arange(n), torch.ones(n, 9), (), n)
    ground = grid.Occupancy(place.ground.lattice(0.05), np.full(place.ground.lattice(0.05).shape, -1.0, np.float32))
    return team.Robot(
        index, plans[index].position, 0.0, place.goals[index], local, ground, team.Guests.none(2),
        plans[index].position[None], plans={index: plans[index]},
    )  # fmt: skip


def test_a_distributed_cycle_weighs_the_same_for_maps_of_100_and_10000_splats(place):
    config = SMALL.replace(codec="binary", tolerance=0.0)
    paths = [place.ground.shortest_path(place.starts[k], place.goals[k], 0.2)[:40:5] for k in range(3)]
    plans = [messages.Plan(k, 0, path[3], 0.3 * k, path) for k, path in enumerate(paths)]

    def weigh(strategy: str, n: int) -> dict[str, int]:
        robots, mission, post = after([synthetic(k, n, place, plans) for k in range(3)], place, strategy, config)
        gains = np.stack([team.serve(robot, mission) for robot in robots])
        assert (gains.max(2) > 0).all()
        team.suggest(robots, gains, mission, post, 0)
        team.agree(robots, gains, mission, post, 0, "cadmm")
        return post.ledger.by_kind()

    assert weigh("distributed", 100) == weigh("distributed", 10_000)
    assert weigh("centralized", 10_000)["Splats"] > 90 * weigh("centralized", 100)["Splats"]


def test_agreeing_by_messages_is_the_solver_itself(crew, place):
    robots, mission, post = after(crew, place, "distributed")
    gains = np.stack([team.serve(robot, mission) for robot in robots])
    announced = np.array([robot.announced for robot in robots])
    config = mission.config
    for solver in ("cadmm", "cadmm-gradient", "cadmm-literal"):
        yaws, _ = team.agree(robots, gains, mission, post, 0, solver)
        trace = consensus.solve(
            gains, mission.network, announced, solver, penalty=config.penalty, growth=config.penalty_growth,
            rounds=config.rounds, tolerance=config.tolerance,
        )  # fmt: skip
        assert np.allclose(yaws, trace[-1].yaws)


def test_json_and_binary_agree_on_the_same_yaws(crew, place):
    answers = []
    for codec in ("json", "binary"):
        config = SMALL.replace(codec=codec)
        robots, mission, post = after(crew, place, "distributed", config)
        gains = np.stack([team.serve(robot, mission) for robot in robots])
        answers.append((team.agree(robots, gains, mission, post, 0, "cadmm")[0], post.ledger.total()))
    assert np.allclose(answers[0][0], answers[1][0], atol=1e-6)
    assert answers[1][1] < answers[0][1]


def test_moving_ends_at_the_viewpoint_with_the_chosen_yaw_and_keeps_clear_of_walls(crew, place):
    mission = mission_for(place, "single")
    for robot in crew:
        moved = team.move(robot, 1.0, mission, 0)
        viewpoint = robot.plans[robot.index].position
        assert np.linalg.norm(moved.position - viewpoint) <= SMALL.step
        assert abs(math.remainder(moved.yaw - 1.0, 2 * math.pi)) <= SMALL.turn / 2 + 1e-9
        assert moved.collisions == 0
        assert place.ground.clearance(moved.trail).min() >= SMALL.robot_radius
        steps = np.linalg.norm(np.diff(moved.trail, axis=0), axis=1)
        assert np.allclose(steps, SMALL.step)
        assert moved.frames[-1].pose.yaw == pytest.approx(moved.yaw)


def test_the_first_look_around_sees_free_ground_all_about(place):
    mission = mission_for(place, "single")
    robot = team.start(0, place.starts[0, :-1], 0.3, place.goals[0], mission)
    lattice = robot.ground.lattice
    around = place.starts[0, :2] + 0.25 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1.0]])
    assert (lattice.at(robot.ground.state, around, grid.UNKNOWN) == grid.FREE).all()
    assert len(robot.frames) == 4
    hits = lattice.centers(np.argwhere(robot.ground.state == grid.OCCUPIED))
    assert place.ground.clearance(hits).max() <= 0.05  # every occupied cell touches a true surface


def test_a_users_strategy_solver_and_measure_run_by_name():
    def whisper(robots, mission, post, cycle):
        for robot in robots:
            for k in range(len(robots)):
                if k != robot.index and robot.index in robot.plans:
                    post.send(robot.index, k, robot.plans[robot.index], cycle)
        return [robot.replace(plans={**robot.plans}) for robot in robots]

    def north(objectives, graph, yaws, settings):
        return np.full(len(yaws), math.pi / 2)

    team.register("whisper", whisper, team.serve_own)
    consensus.register("north", north)
    risk.register("timid", lambda mean, std, level: mean - 5 * std)
    try:
        config = SMALL.replace(solver="north", measure="timid", max_cycles=1)
        record = episode.run("flat", "whisper", config, n_robots=2)
        assert set(record.ledger.by_kind()) == {"Plan"}
        assert [robot.chosen for robot in record.cycles[0].robots] == [math.pi / 2] * 2
        plain = episode.run("flat", "whisper", config.replace(measure="avar"), n_robots=2)
        assert record.cycles[0].best_gain != plain.cycles[0].best_gain  # other risk, other masks
    finally:
        del team.REGISTRY["whisper"], consensus.SOLVERS["north"], risk.MEASURES["timid"]


@pytest.mark.parametrize("name", team.STRATEGIES)
def test_the_papers_strategies_cannot_be_replaced(name):
    with pytest.raises(ValueError, match=name):
        team.register(name, team.share_plans, team.serve)


def test_a_disconnected_network_is_named():
    graph = nx.Graph()
    graph.add_nodes_from(range(3))
    graph.add_edge(0, 1)
    with pytest.raises(ValueError, match="2"):
        network.check(graph, 3)


def test_the_information_of_past_views_follows_the_map(crew, place):
    """The prior after `observe` is that of all keyframes on today's map; the incremental one is only close to it."""
    mission = mission_for(place, "single")
    robot = team.observe(team.move(crew[0], 0.5, mission, 0), mission, 1)
    poses = [frame.pose for frame in robot.local.keyframes]
    assert torch.allclose(robot.local.prior, information.prior(robot.local.splats, mission.camera, poses))
    cheap = mission_for(place, "single", SMALL.replace(prior="incremental"))
    other = team.observe(team.move(crew[0], 0.5, cheap, 0), cheap, 1)
    assert not torch.allclose(other.local.prior, robot.local.prior)
    assert 0.2 < float(other.local.prior.sum() / robot.local.prior.sum()) < 5
