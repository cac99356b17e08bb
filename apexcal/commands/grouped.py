"""A command whose many options its help shows in groups, with examples at the end."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperCommand


def option(name: str, group: str, metavar: str | None, said: str) -> Any:
    """An option of a group; ``metavar`` says the unit, None where the choices are listed."""
    return typer.Option(name, help=said, metavar=metavar, rich_help_panel=group)


def grouped(examples: str) -> type[TyperCommand]:
    """The class of a command with groups of options and, below them, these examples."""

    class Grouped(TyperCommand):
        def format_options(self, ctx: Any, formatter: Any) -> None:
            groups: dict[str, list[tuple[str, str]]] = {}
            for parameter in self.get_params(ctx):
                record = parameter.get_help_record(ctx)
                if record is not None:
                    groups.setdefault(getattr(parameter, "rich_help_panel", None) or "Other", []).append(record)
            for group, records in groups.items():
                with formatter.section(group):
                    formatter.write_dl(records, col_max=24)

        def format_epilog(self, ctx: Any, formatter: Any) -> None:
            with formatter.section("Examples"):
                for line in examples.splitlines():
                    formatter.write(f"  {line}\n")

    return Grouped
