"""The one way in which anything crosses a link, and what a robot makes of what it hears.

A phase is a function of one robot: (robot, mission) → what it sends, pairs of a receiver, or None for everybody, and a
message. `hear` makes a new record of a robot and one message. Neither is ever handed a second robot.
"""

import functools
from collections.abc import Callable, Iterable

from mannbv.messages import Copies, Grid, Letter, Mailbox, Message, Plan, Profile, Splats, Suggestion
from mannbv.team.robots import Mission, Robot

Phase = Callable[[Robot, Mission], Iterable[Letter]]
Hear = Callable[[Robot, Message], Robot]


def hear(robot: Robot, message: Message) -> Robot:
    """The robot after one message. Raises ValueError for a kind that it does not understand."""
    sender, choice = message.robot, robot.choice
    match message:
        case Plan():
            return robot.replace(plans={**robot.plans, sender: message})
        case Splats():
            return robot.replace(guests=robot.guests.received(message))
        case Grid():
            return robot.replace(grids={**robot.grids, sender: message.occupancy})
        case Suggestion() if choice:
            return robot.replace(choice=choice.replace(suggestions=(*choice.suggestions, message)))
        case Profile() if choice:
            return robot.replace(choice=choice.replace(profiles=(*choice.profiles, message)))
        case Copies() if choice:
            return robot.replace(choice=choice.replace(copies={**choice.copies, sender: message.offsets}))
    raise ValueError(f"team: robot {robot.index} cannot use a {type(message).__name__} of robot {sender} now")


def each(robots: list[Robot], stage: Callable[..., Robot], *arguments: object) -> list[Robot]:
    """Every robot after a stage that it goes through alone: stage(robot, *arguments) → robot."""
    return [stage(robot, *arguments) for robot in robots]


def exchange(
    robots: list[Robot], phase: Phase, mission: Mission, mailbox: Mailbox, understand: Hear = hear
) -> list[Robot]:
    """Every robot after a phase: all speak, the mailbox carries it link by link, all hear."""
    arrived = mailbox.deliver({robot.index: phase(robot, mission) for robot in robots}, mission.network)
    return [functools.reduce(understand, arrived[robot.index], robot) for robot in robots]
