"""What Tab completes beside commands and options: scenarios and their settings, files, filters."""

import dataclasses

import click
from click.shell_completion import CompletionItem

from host.registry import FILTERS, SCENARIOS


def scenarios(context: click.Context, option: click.Parameter, text: str) -> list[CompletionItem]:
    """Names of scenarios; behind a colon or a comma, settings. Not bash's: it ends words there."""
    name, colon, settings = text.partition(":")
    if not colon:
        return [CompletionItem(each) for each in SCENARIOS.names() if each.startswith(name)]
    from host.simulation.world.scenarios import Scenario

    *before, last = settings.split(",")
    keys = [field.name for field in dataclasses.fields(Scenario) if field.name.startswith(last)]
    return [CompletionItem(f"{name}:{','.join([*before, key])}=") for key in keys]


def sources(context: click.Context, option: click.Parameter, text: str) -> list[CompletionItem]:
    """Scenarios; where the text begins none, files."""
    return scenarios(context, option, text) or [CompletionItem(text, type="file")]


def filters(context: click.Context, option: click.Parameter, text: str) -> list[CompletionItem]:
    """Names of filters, the last of several behind commas."""
    *before, last = text.split(",")
    names = [name for name in FILTERS.names() if name.startswith(last)]
    return [CompletionItem(",".join([*before, name])) for name in names]
