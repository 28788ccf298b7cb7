"""Algorithm 1 and the four strategies: who hears what, what it weighs in bytes, and users' own strategies."""

import dataclasses
import math
import pickle

import networkx as nx
import numpy as np
import pytest
import torch
from helpers import random_map

from mannbv import consensus, episode, grid, information, messages, network, risk, team, world
from mannbv.camera import Camera
from mannbv.config import Config
from mannbv.episode import record
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
    return [team.plan(team.observe(robot, mission, 0), mission) for robot in robots]


def after(robots, place, strategy, config=SMALL, graph="complete"):
    """The robots once the strategy's phases are over, their mission, and the mailbox."""
    mission = mission_for(place, strategy, config, graph)
    mailbox = messages.Mailbox(config.codec, network=mission.network)
    return team.share(list(robots), mission, mailbox, team.REGISTRY[strategy]), mission, mailbox


def agreed(robots, mission, mailbox, solver="cadmm"):
    """The robots once they have evaluated, suggested and agreed, all as distributed ones do; and the residuals."""
    robots = team.each(robots, team.evaluate, mission, team.serve)
    robots = team.exchange(robots, team.suggest, mission, mailbox)
    return team.agree(robots, mission, mailbox, solver)


def test_single_robots_say_nothing_and_weigh_only_their_own_view(crew, place):
    robots, mission, post = after(crew, place, "single")
    gains = np.stack([team.REGISTRY["single"].evaluate(robot, mission) for robot in robots])
    robots = team.each(robots, team.evaluate, mission, team.serve_own)
    team.agree(team.exchange(robots, team.suggest, mission, post), mission, post)
    assert post.ledger.total() == 0
    assert (gains[~np.eye(3, dtype=bool)] == 0).all()
    assert (gains[np.eye(3, dtype=bool)].max(1) > 0).all()


def test_distributed_robots_hear_every_plan_and_never_a_splat(crew, place):
    robots, mission, post = after(crew, place, "distributed")
    assert all(sorted(robot.plans) == [0, 1, 2] for robot in robots)
    assert all(robot.guests.splats.n_splats == 0 and not robot.grids for robot in robots)
    agreed(robots, mission, post)
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
            assert torch.equal(robot.guests.sent[row], theirs.prior[same])
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
        known = belief.ground.lattice.at(belief.ground.state, centers, grid.UNKNOWN) != grid.UNKNOWN
        assert (known == seen.ravel()).all()
    smaller = crew[0].local.splats.select(torch.arange(5))
    fewer = crew[0].replace(
        local=LocalMap(smaller, crew[0].local.ids[:5], crew[0].local.prior[:5], crew[0].local.keyframes)
    )
    later, _, _ = after([fewer, *robots[1:]], place, "centralized")
    assert int((later[1].guests.senders == 0).sum()) == 5  # a whole map replaces the one before


@pytest.mark.parametrize("margin", [1.0, 0.25])
def test_a_robot_plans_on_what_it_knows_and_a_margin_around(crew, margin):
    robot = crew[0]
    cells = np.argwhere(robot.ground.log_odds != 0)
    centers = robot.ground.lattice.centers(cells)
    known = np.concatenate([centers, robot.position[None], robot.goal[None]])
    lattice = robot.belief(SMALL.replace(ground_margin=margin)).ground.lattice
    upper = np.array(lattice.origin) + lattice.cell * np.array(lattice.shape)
    whole = np.array(robot.ground.lattice.origin), robot.ground.lattice.cell * np.array(robot.ground.lattice.shape)
    low = np.maximum(known.min(0) - margin, whole[0])
    high = np.minimum(known.max(0) + margin, whole[0] + whole[1])
    assert np.abs(lattice.origin - low).max() < 0.06 and np.abs(upper - high).max() < 0.06


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
        assert (np.stack([team.serve(robot, mission) for robot in robots]).max(2) > 0).all()
        agreed(robots, mission, post)
        return post.ledger.by_kind()

    assert weigh("distributed", 100) == weigh("distributed", 10_000)
    assert weigh("centralized", 10_000)["Splats"] > 90 * weigh("centralized", 100)["Splats"]


def test_agreeing_by_messages_is_the_solver_itself(crew, place):
    robots, mission, post = after(crew, place, "distributed")
    gains = np.stack([team.serve(robot, mission) for robot in robots])
    announced = np.array([robot.announced for robot in robots])
    config = mission.config
    for solver in ("cadmm", "cadmm-gradient", "cadmm-literal"):
        yaws = [robot.choice.yaw for robot in agreed(robots, mission, post, solver)[0]]
        trace = consensus.solve(
            gains, mission.network, announced, solver, penalty=config.penalty, growth=config.penalty_growth,
            rounds=config.rounds, tolerance=config.tolerance,
        )  # fmt: skip
        assert np.allclose(yaws, trace[-1].yaws)


@pytest.mark.parametrize("steps", [5, 3])
def test_a_stochastic_agreement_draws_by_the_missions_seed_and_the_cycle(crew, place, steps):
    config, found = SMALL.replace(solver="cadmm-stochastic", primal_steps=steps, primal_rate=0.1), []
    for seed, number in ((5, 0), (5, 1), (6, 0)):
        mission = mission_for(place, "distributed", config, seed=seed)
        robots = team.share(
            [robot.replace(cycle=number) for robot in crew], mission, messages.Mailbox(), team.REGISTRY["distributed"]
        )
        robots = team.each(robots, team.evaluate, mission, team.serve)
        gains, announced = np.stack([r.choice.gains for r in robots]), np.array([r.announced for r in robots])
        ended, _ = team.agree(
            team.exchange(robots, team.suggest, mission, messages.Mailbox()), mission, messages.Mailbox()
        )
        found.append([robot.choice.yaw for robot in ended])
        rule = consensus.CADMM(
            config.penalty, config.penalty_growth, "stochastic", steps=steps, rate=0.1, seed=(seed, number)
        )
        states = [rule.start(k, {0, 1, 2} - {k}, announced, gains[k] / gains.max()) for k in range(3)]

        def deliver(outbox):
            heard = {k: {} for k in range(3)}
            for note in outbox:
                heard[note.receiver][note.sender] = note.offsets
            return heard

        *_, last = consensus.exchange(rule, states, deliver, config.rounds, config.tolerance)
        assert np.allclose(found[-1], [state.yaw for state in last])
    assert not np.allclose(found[0], found[1]) and not np.allclose(found[0], found[2])


def test_json_and_binary_agree_on_the_same_yaws(crew, place):
    answers = []
    for codec in ("json", "binary"):
        config = SMALL.replace(codec=codec)
        robots, mission, post = after(crew, place, "distributed", config)
        yaws = [robot.choice.yaw for robot in agreed(robots, mission, post)[0]]
        answers.append((yaws, post.ledger.total()))
    assert np.allclose(answers[0][0], answers[1][0], atol=1e-6)
    assert answers[1][1] < answers[0][1]


def test_moving_ends_at_the_viewpoint_with_the_chosen_yaw_and_keeps_clear_of_walls(crew, place):
    mission = mission_for(place, "single")
    for robot in crew:
        moved = team.move(robot, mission, 1.0)
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
    def whisper(robot, mission):
        for k in range(len(mission.network)):
            if k != robot.index and robot.index in robot.plans:
                yield k, robot.plans[robot.index]

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
        team.register(name, team.announce, team.serve)


def test_a_disconnected_network_is_named():
    graph = nx.Graph()
    graph.add_nodes_from(range(3))
    graph.add_edge(0, 1)
    with pytest.raises(ValueError, match="2"):
        network.check(graph, 3)


def test_the_information_of_past_views_follows_the_map(crew, place):
    """The prior after `observe` is that of all keyframes on today's map; the incremental one is only close to it."""
    mission = mission_for(place, "single")
    robot = team.observe(team.move(crew[0], mission, 0.5), mission, 1)
    poses = [frame.pose for frame in robot.local.keyframes]
    assert torch.allclose(robot.local.prior, information.prior(robot.local.splats, mission.camera, poses))
    cheap = mission_for(place, "single", SMALL.replace(prior="incremental"))
    other = team.observe(team.move(crew[0], cheap, 0.5), cheap, 1)
    assert not torch.allclose(other.local.prior, robot.local.prior)
    assert 0.2 < float(other.local.prior.sum() / robot.local.prior.sum()) < 5


# ---- what may not happen --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("graph", ["complete", "line"])
@pytest.mark.parametrize("strategy", team.STRATEGIES)
def test_robots_that_are_bytes_between_any_two_phases_come_to_the_same_bits(place, strategy, graph, monkeypatch):
    """Nothing that one robot holds is shared with another one, or with what an earlier stage held."""
    mission = mission_for(place, strategy, graph=graph)
    starts, goals = place.starts, place.goals
    robots = [team.start(k, starts[k, :-1], float(starts[k, -1]), goals[k], mission) for k in range(3)]

    def two_cycles():
        now, mailbox, logs = robots, messages.Mailbox(network=mission.network), []
        for number in range(2):
            now, log = team.cycle(now, mission, mailbox, number)
            logs.append(dataclasses.replace(log, seconds=team.Seconds()))
        return [record.to_arrays(robot) for robot in now], logs, mailbox.ledger.rows

    whole, phases = two_cycles(), []

    def through_bytes(function):
        def parted(robots, phase, *rest):
            phases.append(phase)
            return function([pickle.loads(pickle.dumps(robot)) for robot in robots], phase, *rest)

        return parted

    for module in (team.algorithm, team.agreement, team.strategies):
        for name in {"each", "exchange"} & set(vars(module)):
            monkeypatch.setattr(module, name, through_bytes(getattr(team, name)))
    bytewise = two_cycles()
    assert len(phases) >= 2 * 6  # observe, plan, meet, evaluate, suggest, move, and what the strategy sends
    assert bytewise[1:] == whole[1:]
    for one, other in zip(bytewise[0], whole[0], strict=True):
        assert one.keys() == other.keys() and all(np.array_equal(one[key], other[key]) for key in one)


def test_the_records_of_earlier_cycles_stand_still_and_messages_keep_to_the_links():
    """A record given to `progress` is whole: its ledger must not grow with the cycles after it."""
    kept = []
    config = SMALL.replace(network="line", max_cycles=2)
    episode.run("flat", "distributed", config, n_robots=3, progress=kept.append)
    totals = [record.ledger.total() for record in kept]
    assert 0 < totals[0] < totals[1] == totals[2]
    assert max(kept[0].ledger.by_cycle()) == 0
    links = {tuple(sorted(link)) for link in kept[-1].ledger.by_link()}
    assert links == {(0, 1), (1, 2)}


def test_a_strategy_cannot_send_where_there_is_no_link():
    def shout(robots, mission, mailbox, cycle):
        mailbox.send(0, 2, robots[0].plans[0], cycle)
        return robots

    with pytest.warns(DeprecationWarning, match="'shout' shares in the old form"):
        team.register("shout", shout, team.serve_own, "own")
    try:
        with pytest.raises(ValueError, match="robot 0 has no link to robot 2"):
            episode.run("flat", "shout", SMALL.replace(network="line", max_cycles=1), n_robots=3)
    finally:
        del team.REGISTRY["shout"]


def test_a_message_at_the_wrong_time_is_named(crew):
    note = messages.Copies(1, 0, 0, np.zeros(3))
    with pytest.raises(ValueError, match="robot 0 cannot use a Copies of robot 1 now"):
        team.hear(crew[0], note)


def test_everyone_scales_by_the_same_number_even_if_it_has_nothing_to_suggest(crew, place):
    """The largest gain of the team reaches also those of whose views its owner's map says nothing."""
    mission = mission_for(place, "distributed")
    mailbox = messages.Mailbox(network=mission.network)

    def gains_of(robot, mission):
        rows = np.zeros((3, SMALL.n_yaws))
        rows[robot.index] = 10.0 ** (robot.index + 1)
        return rows

    robots = team.each(crew, team.evaluate, mission, gains_of)
    assert [robot.choice.scale for robot in robots] == [10.0, 100.0, 1000.0]
    robots = team.exchange(robots, team.suggest, mission, mailbox)
    assert [robot.choice.scale for robot in robots] == [1000.0] * 3


@pytest.mark.parametrize("occluded", [False, True])
def test_what_the_holder_has_seen_counts_as_known_of_its_guests(crew, place, occluded):
    """A guest's prior is the sender's information and that of all own keyframes, its own splats before or behind it."""
    robots, mission, _ = after(crew, place, "limited")
    robot = max(robots, key=lambda robot: robot.guests.splats.n_splats)
    if not occluded:
        robot = robot.replace(local=robot.local.select(torch.zeros(robot.local.splats.n_splats, dtype=torch.bool)))
    met = team.meet(robot, mission).guests
    poses = [frame.pose for frame in robot.local.keyframes]
    own = sum(information.fisher(met.splats, mission.camera, pose, robot.local.splats) for pose in poses)
    assert met.splats.n_splats and bool((own > 0).any())
    assert torch.allclose(met.prior, met.sent + own)
    assert not torch.allclose(met.prior, met.sent)
    # the next frames add to it
    later = team.observe(team.move(robot.replace(guests=met), mission, 0.3), mission, 1)
    assert (later.guests.prior >= met.prior).all() and (later.guests.prior > met.prior).any()


def test_what_was_seen_of_a_guest_stays_known_when_it_comes_again(rng):
    """Rows are matched by sender and id, whatever their order; only splats that never came are looked up anew."""

    def letter(robot: int, ids: list[int], whole: int):
        return messages.Splats(
            robot, 0, random_map(rng, len(ids), 2, torch.float32), ids, np.ones((len(ids), 9)), whole
        )

    guests = team.Guests.none(2).received(letter(1, [4, 7, 2], 0)).received(letter(2, [7, 4], 0))
    known = dataclasses.replace(guests, seen=torch.arange(5.0)[:, None].expand(5, 9))
    part = known.received(letter(1, [2, 9, 4], 0))
    rows = dict(zip(zip(part.senders.tolist(), part.ids.tolist(), strict=True), part.seen[:, 0].tolist(), strict=True))
    assert math.isnan(rows.pop((1, 9)))
    assert rows == {(1, 7): 1.0, (2, 7): 3.0, (2, 4): 4.0, (1, 2): 2.0, (1, 4): 0.0}
    whole = known.received(letter(1, [9, 7], 1))
    assert whole.ids.tolist() == [7, 4, 9, 7]
    assert whole.seen[:, 0].nan_to_num(-1).tolist() == [3.0, 4.0, -1.0, 1.0]
