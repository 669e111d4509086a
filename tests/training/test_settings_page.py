"""docs/training-settings.md says every setting of a run as its model does.

``python -m tests.training.test_settings_page`` writes it anew.
"""

import inspect
import re
from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic import BaseModel

from tmca.training import TRAININGS

PAGE = Path(__file__).parents[2] / "docs" / "training-settings.md"
GROUPS = ("camera", "noise", "decoder", "codes", "data", "optimiser")
HEAD = """# Settings of a training run

What `tmca train CAMERA --config run.yaml` and `--set name=value` take,
with defaults; presets replace some of them ([training](training.md)).
`tmca train --from` takes those of data, optimiser and precision ([fine-tuning](fine-tuning.md)).
"""


def settings(model, path=""):
    """(dotted name, default, what it is) of every setting."""
    for name, field in model.model_fields.items():
        kind = field.annotation
        if inspect.isclass(kind) and issubclass(kind, BaseModel):
            yield from settings(kind, f"{path}{name}.")
        elif not (get_origin(kind) is Literal and len(get_args(kind)) == 1):  # else there is nothing to choose
            yield f"{path}{name}", default(name, field), cell(described(model, name) + choices(kind))


def default(name, field):
    value = field.get_default(call_default_factory=True)
    shown = list(value) if isinstance(value, tuple) else value
    empty = value in (None, (), {})
    return "one ideal sensor" if name == "noise" else "" if empty else f"`{shown}`".replace("'", "")


def described(model, name):
    """What the model says of a field, or one that it goes on from."""
    texts = (one.model_fields[name].description for one in model.__mro__ if name in getattr(one, "model_fields", {}))
    return next(filter(None, texts), "")


def choices(kind):
    named = ", ".join(f"`{one}`" for one in get_args(kind))
    return f" One of {named}." if get_origin(kind) is Literal else ""


def cell(text):
    return re.sub(r"\s+", " ", text).replace("``", "`").replace("|", "\\|").strip()


def page():
    """Settings that all cameras have alike, then those of each."""
    every = {kind: list(settings(training.settings)) for kind, training in sorted(TRAININGS.items())}
    alike = [row for row in next(iter(every.values())) if all(row in rows for rows in every.values())]
    own = {f"`{kind}`": [row for row in rows if row not in alike] for kind, rows in every.items()}
    lines = [HEAD.rstrip()]
    for title, rows in {"Every camera": alike, **own}.items():
        lines += ["", f"## {title}", "", "| setting | default | |", "|---|---|---|"]
        lines += [f"| `{name}` | {value} | {text} |" for name, value, text in sorted(rows, key=place_of)]
    return "\n".join(lines) + "\n"


def place_of(row):
    return next((n for n, group in enumerate(GROUPS) if row[0].startswith(group)), len(GROUPS))


def test_the_page_is_what_the_models_say():
    assert PAGE.read_text() == page(), "run: python -m tests.training.test_settings_page"


def test_every_setting_is_explained():
    rows = [row for training in TRAININGS.values() for row in settings(training.settings)]
    assert [name for name, _, text in rows if not text] == []
    assert {"camera.learn", "codes.throughput", "data.margin", "optimiser.mask_rate"} <= {name for name, *_ in rows}


if __name__ == "__main__":
    PAGE.write_text(page())
