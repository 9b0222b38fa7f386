from collections import Counter
from dataclasses import fields
from pathlib import Path

import pytest

from experiments.matrix.cell import Cell
from experiments.matrix.grid import Grid, Trainer
from experiments.matrix.grid_toml import load_cells
from transferkit.errors import ConfigError

DOCS = Path(__file__).parents[3] / "docs" / "experiments.md"
LAST = "eval_episodes = 2"
"""The grid's last line, which wrong ones replace."""


def trainer(text, message):
    """A grid whose last line is replaced by a trainer with these keys, and what is said of it."""
    return LAST, f"[[trainer]]\n{text}", message


def setting(text, message):
    return trainer(f"set = {{ {text} }}", message)


def part(text, message):
    """A grid whose last line is replaced by two parts, the second with these keys."""
    return LAST, f"[[part]]\n[[part]]\n{text}", message


WRONG = {
    "no budget": ("steps = 150", "", "budget: no budget given"),
    "budget of nothing, and more": ("steps = 150", "steps = 0\nepisodes = 3", "steps=0"),
    "negative budget": ("steps = 150", "steps = -1", "steps=-1"),
    "arm": ('"transfer"', '"transfers"', "arms: unknown arm 'transfers'; did you mean transfer"),
    "target": ("InvertedDoublePendulum-v5", "Inverted-v0", "targets: unknown environment 'Inverted-v0'"),
    "module": (
        "InvertedDoublePendulum-v5",
        "own:X-v0",
        "own:X-v0 runs a module; if you trust that, name it to the command as well",
    ),
    "core": ("inverted-pendulum-v1", "nothing-v1", "cores: .*nothing-v1"),
    "no cores": ('cores = ["inverted-pendulum-v1"]', "", "cores: the arms transfer, random need some"),
    "seeds backwards": ('"0-1"', '"1-0"', "seeds='1-0' must be a list of whole numbers"),
    "seeds in other digits": ('"0-1"', '"0-²"', "seeds=.* must be a list of whole numbers"),
    "negative seed": ('seeds = "0-1"', "seeds = [-1]", "seeds=.* whole numbers from 0"),
    "too many seeds": ('"0-1"', '"0-99999999999"', "seeds=.* must be at most 10,000"),
    "seed twice": part("seeds = [5, 5]", "part 2: seeds: 5 stands there more than once"),
    "seed twice in a list of parts": (LAST, 'part = [{ seeds = "0-1" }, { seeds = [5, 5] }]', "part 2: seeds: 5 stands"),
    "member": ("steps = 150", "steps = 150\nmembers = [9]", "member=9 must be 0 to 4 for core"),
    "no members": (LAST, "members = []", "members: the grid has none"),
    "key": ("steps = 150", "step = 150", "grid: unknown key 'step'; did you mean steps"),
    "not TOML": (LAST, "eval_episodes = ", "not TOML"),
    "a number as part": (LAST, "part = [1]", r"part=\[1\] must be written as \[\[part\]\]"),
    "no part": (LAST, "part = []", "must be written as"),
    "a number as arm": ('"transfer"', "5", "arms=.* must be a list of names"),
    "a number as trainer": (LAST, "trainer = [1]", "trainer=.* must be a list of tables"),
    "a number as set": trainer("set = 3", "trainer: set=3 must be a table"),
    "a text as seconds": ("steps = 150", 'seconds = "a"', "seconds='a' must be a number"),
    "a number as device": ("steps = 150", "steps = 150\ndevice = 1", "device=1 must be a name"),
    "device": ("steps = 150", 'steps = 150\ndevice = "banana"', "device='banana' must be a device of torch"),
    "a fraction as steps": ("steps = 150", "steps = 1.5", "steps=1.5 must be a whole number"),
    "negative eval_every": (LAST, "eval_every = -1", "eval_every=-1 must be at least 0"),
    "no evaluation": (LAST, "eval_episodes = 0", "eval_episodes=0 must be at least 1"),
    "setting": setting('"ppo.speed" = 1', "trainer: unknown setting 'ppo.speed'"),
    "setting, nearly": setting('"ppo.learnin_rate" = 1', "did you mean ppo.learning_rate"),
    "property as a setting": setting('"ppo.capacity" = 1', "unknown setting 'ppo.capacity'"),
    "algo": trainer('algo = "sac"', "trainer: unknown trainer 'sac'"),
    "preset of another trainer": trainer('algo = "dyna-ppo"\npreset = "paper"', "unknown preset of dyna-ppo 'paper'"),
    "setting of another trainer": setting('"dyna.horizon" = 7', "dyna.horizon is not a setting of ppo"),
    "negative width": setting('"network.hidden" = [-1]', "network.hidden=.* must be"),
    "half a width": setting('"network.hidden" = [64, 0.5]', "network.hidden=.* must be a list, each item a whole number"),
    "discount": setting('"ppo.gamma" = 2.0', "ppo.gamma=2.0 must be at least 0 and at most 1"),
    "discount as a list": setting('"ppo.gamma" = [0.9]', "ppo.gamma=.* must be a number"),
    "no discount": setting('"ppo.gamma" = "none"', "ppo.gamma=None must be a number"),
    "tau": setting('"dyna.tau" = 3', "dyna.tau=3 must be above 0 and at most 1"),
    "tap": setting('"wrap.tap" = "feature"', "wrap.tap='feature' must be features or action; did you mean features"),
    "freeze": setting('"wrap.freeze" = { core = "all" }', "wrap.freeze.core='all' must be a number"),
    "two settings": part('trainer = [{ set = { "ppo.gamma" = 0.9 } }]', "runs of ppo on .* with 2 settings; .*own name"),
    "two budgets": part("steps = 200\nseeds = [5]", "runs of ppo on InvertedDoublePendulum-v5 with 2 budgets"),
    "two wrappings": part('seeds = [5]\ntrainer = [{ set = { "wrap.residual" = 0 } }]', "with 2 settings"),
    "two evaluations": part("eval_episodes = 3\narms = ['zero-action']", "runs of zero-action .* one eval_episodes"),
    "two names": trainer('[[trainer]]\nname = "two"', "trainer: 'ppo' and 'two' are the same runs; leave one out"),
    "one name twice": trainer(
        '[[trainer]]\nset = { "ppo.gamma" = 0.9 }', "'ppo' stands there more than once; give each a name"
    ),
    "an adapter that finds nothing": (
        'Pendulum-v5"]\narms',
        'Pendulum-v5", "Reacher-v5"]\ntrainer = [{ set = { "wrap.adapter" = "semantic" } }]\narms',
        "Reacher-v5: .*adapter='semantic'|adapter.*Reacher-v5",
    ),
    "an arm without its part": (
        'arms = ["transfer"',
        'trainer = [{ preset = "paper" }]\narms = ["padded", "transfer"',
        "arm padded of inverted-pendulum-v1 .*output_adapter",
    ),
}


def test_a_grid_is_a_product_in_which_nothing_is_run_twice(grid):
    cells = load_cells(grid('arms = ["transfer"', 'members = [0, 1]\narms = ["constant", "scratch-matched", "transfer"'))
    counts = Counter(cell.arm for cell in cells)
    assert counts == {"transfer": 4, "random": 4, "scratch-matched": 2, "scratch": 2, "constant": 2, "zero-action": 1}
    assert len({cell.id for cell in cells}) == len(cells)
    parts = '[[part]]\n[[part]]\ntargets = ["InvertedPendulum-v5"]\narms = ["scratch"]\n'
    assert len(load_cells(grid(more=parts))) == 7 + 2


def test_settings_may_be_quoted_or_not(grid):
    text = 'ppo.learning_rate = 0.5, ppo.schedule = "fixed", ppo.epochs = 3, "ppo.max_grad_norm" = "none"'
    cells = load_cells(grid(more=f"[[trainer]]\nset = {{ {text} }}\n"))
    found = {(cell.config.ppo.epochs, cell.config.ppo.max_grad_norm) for cell in cells if cell.arm == "transfer"}
    assert found == {(3, None)}


def test_the_grid_of_the_docs_has_every_key(tmp_path):
    text = DOCS.read_text().partition("```toml\n")[2].partition("```")[0]
    keys = {line.partition(" = ")[0] for line in text.splitlines()}
    assert {f.name for f in (*fields(Grid), *fields(Trainer))} - keys == {"trainer", "steps", "seconds"}
    (tmp_path / "grid.toml").write_text(text)
    assert len(load_cells(tmp_path / "grid.toml")) == 10 * (2 * 4 + 1) + 1 + 5 * (2 * 4 + 1) + 1


@pytest.mark.parametrize(("old", "new", "message"), WRONG.values(), ids=[*WRONG])
def test_a_wrong_grid_is_refused_before_anything_runs(grid, old, new, message):
    with pytest.raises(ConfigError, match=message) as caught:
        load_cells(grid(old, new))
    assert "grid.toml" in str(caught.value)
    assert "--" not in str(caught.value)  # a grid has no flags


def test_a_row_tells_its_cell(grid):
    cells = load_cells(grid(more='[[trainer]]\nname = "other"\nset = { "ppo.gamma" = 0.9, "wrap.residual" = 0 }'))
    on_cuda = load_cells(grid("steps = 150", 'steps = 150\ndevice = "cuda"'))
    for cell in (*cells, *on_cuda):
        assert Cell.from_row(cell.row).id == cell.id
    assert {cell.row.device for cell in on_cuda} == {"cuda", ""}  # zero action's
    assert not {cell.id for cell in cells if cell.arm == "scratch"} & {cell.id for cell in on_cuda}
    assert {cell.row.overrides for cell in cells if cell.trainer == "other"} == {'{"ppo.gamma": 0.9, "wrap.residual": 0}'}


def test_a_budget_of_nothing_evaluates_policies_as_they_begin(grid):
    cells = load_cells(grid("steps = 150", "steps = 0"))
    assert not any(cell.trained for cell in cells)
    assert {cell.row.budget for cell in cells} == {(None, None, None)}


def test_a_grid_without_cores_trains_from_scratch(grid):
    path = grid('cores = ["inverted-pendulum-v1"]\n', "")
    path.write_text(path.read_text().replace('"transfer", "scratch", "random"', '"scratch"'))
    assert [cell.arm for cell in load_cells(path)] == ["scratch", "zero-action", "scratch"]
