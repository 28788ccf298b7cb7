"""The commands, a file each: `add` teaches the parser, `run` does it; what it needs is imported there."""

from mannbv.commands import bench, compare, doctor, grade, scenes, tables

COMMANDS = (scenes, compare, tables, bench, grade, doctor)
