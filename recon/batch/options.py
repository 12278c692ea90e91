"""The options of one input, which are the command's own: from its flags, so that a new flag is one here, too."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from recon.command import add_options
from recon.system.arguments import Parser, path


@dataclass(frozen=True)
class Option:
    """A flag of the command: "camera-off"; dest is its name in parsed arguments; a switch takes no value."""

    flag: str
    dest: str
    switch: bool
    path: bool

    def is_path(self, value: Any) -> bool:
        """Whether this value names a file: that of a path's option, or a class that is a model's file."""
        return self.path or (self.flag == "class" and str(value).endswith(".py"))


@cache
def known_options() -> dict[str, Option]:
    """By flag, in the order of the command's help."""
    parser = Parser(add_help=False)
    add_options(parser)
    found = [Option(a.option_strings[0][2:], a.dest, a.nargs == 0, a.type is path) for a in parser._actions]
    return {option.flag: option for option in found}


def add_unsaid(parser: argparse._ActionsContainer) -> None:
    """The same flags for all inputs of a list: None where nothing is said, so that what is said can be told."""
    add_options(parser)
    parser.set_defaults(**dict.fromkeys(option.dest for option in known_options().values()))


def given(args: argparse.Namespace) -> dict[str, Any]:
    """What a command line says for all inputs, by flag: texts, and True of switches."""
    told = ((option, getattr(args, option.dest)) for option in known_options().values())
    return {o.flag: True if o.switch else str(value) for o, value in told if value is not None}


def words_of(options: Mapping[str, Any]) -> list[str]:
    """The options as a command line says them."""
    return [f"--{flag}" if value is True else f"--{flag}={value}" for flag, value in options.items()]
