"""The loop, driven by a trainer that only adds up what it sees."""

import signal

import numpy as np
import pytest
import torch

from tests.toys import Counter
from transferkit.budget import Budget
from transferkit.envs import VectorEnv, make_env
from transferkit.errors import InterruptedRunError, NotFiniteError
from transferkit.evaluation import Evaluation
from transferkit.run import EvaluationRow, RunDirectory, Schedule, Session, load_state, read_table
from transferkit.trainers.loop import migrated_checkpoint, train_and_evaluate


class Adder:
    """Takes one step an advance, and has metrics after every third; `total` weighs observations by the time they are seen."""

    num_envs = 1
    overrun_steps, hold = 0, 1

    def __init__(self, nan_at=None):
        self.total, self.advances, self.nan_at = torch.zeros(2), 0, nan_at

    def advance(self, envs, observation, session):
        self.advances += 1
        self.total += self.advances * torch.from_numpy(observation[0])
        step = envs.step(np.zeros((1, 1), np.float32), session.count)
        loss = float("nan") if self.advances == self.nan_at else 0.0
        return step.observation, {"loss": loss} if self.advances % 3 == 0 else None

    def state(self):
        return {"total": self.total, "advances": self.advances}

    def restore(self, state):
        self.total, self.advances = state["total"], state["advances"]

    def trained(self):
        return {}


SCORES = Evaluation((3.0, 5.0), (2, 2))


def start(path, trainer, *, resume=False, report=None, steps=20, eval_every=0):
    """Train in episodes of 5 steps; the seed of episode k is 10 k."""
    directory, checkpoint = RunDirectory.resume(path) if resume else (RunDirectory.create(path, {}), None)
    envs = VectorEnv([make_env(Counter(5))], lambda _, episode: 10 * episode)
    schedule = Schedule(eval_every, checkpoint_seconds=0.0)
    with directory:
        session = Session(directory, Budget(steps=steps), 1, evaluate=lambda _: SCORES, schedule=schedule, report=report)
        assert train_and_evaluate(trainer, envs, session, checkpoint) == SCORES.scores()
    return session


def test_it_advances_from_the_first_observation_until_the_budget_ends(tmp_path):
    trainer = Adder()
    session = start(tmp_path / "run", trainer, steps=7)
    # observations (seed, step): episode 0 five times, then the first two of episode 1
    seen = np.array([[0, 0], [0, 1], [0, 2], [0, 3], [0, 4], [10, 0], [10, 1]])
    assert trainer.total.tolist() == (np.arange(1, 8) @ seen).tolist()
    assert (session.spent.steps, session.spent.episodes) == (7, 1)


@pytest.mark.parametrize(("every", "steps"), [(0, [20]), (6, [0, 6, 12, 18, 20])])
def test_it_is_evaluated_at_the_end_and_if_asked_for_before_and_during_training(tmp_path, every, steps):
    start(tmp_path / "run", Adder(), eval_every=every)
    assert read_table(tmp_path / "run", EvaluationRow)["steps"].tolist() == steps


def test_reports_come_after_updates_only(tmp_path):
    steps = []
    start(tmp_path / "run", Adder(), report=lambda spent, _: steps.append(spent.steps), steps=10)
    assert steps == [3, 6, 9]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_at_the_next_update_and_the_run_goes_on_from_there(tmp_path, number):
    whole, cut, again = Adder(), Adder(), Adder()
    start(tmp_path / "whole", whole)

    def interrupt(spent, _):
        if spent.steps == 9:
            signal.raise_signal(number)

    with pytest.raises(InterruptedRunError, match=r"stopped at episode 1, step 9; .*cut; the same call .* resume=True"):
        start(tmp_path / "cut", cut, report=interrupt)
    assert cut.advances == 9
    start(tmp_path / "cut", again, resume=True)
    assert again.total.tolist() == whole.total.tolist()
    tables = [(tmp_path / run / "episodes.csv").read_text().splitlines() for run in ("whole", "cut")]
    assert [row.rpartition(",")[0] for row in tables[0]] == [row.rpartition(",")[0] for row in tables[1]]


def test_a_run_that_is_killed_goes_on_from_its_last_checkpoint(tmp_path):
    whole, again = Adder(), Adder()
    start(tmp_path / "whole", whole)

    class KilledError(Exception):
        pass

    def kill(spent, _):
        if spent.steps == 12:
            raise KilledError

    with pytest.raises(KilledError):
        start(tmp_path / "cut", Adder(), report=kill)
    assert load_state(tmp_path / "cut/checkpoint.safetensors")["trainer"]["advances"] == 9
    start(tmp_path / "cut", again, resume=True)
    assert again.total.tolist() == whole.total.tolist()


def test_nan_in_a_loss_stops_and_keeps_the_last_good_checkpoint(tmp_path):
    with pytest.raises(NotFiniteError, match="loss became nan at environment step 6"):
        start(tmp_path / "run", Adder(nan_at=6))
    assert load_state(tmp_path / "run/checkpoint.safetensors")["session"]["spent"][1] == 3


@pytest.mark.parametrize("name", ["algorithm", "agent", "learner"])
def test_a_checkpoint_of_version_0_1_is_brought_into_todays_form(name):
    own, envs = {"weights": torch.ones(2)}, {"episode": [3], "actions": [[]]}
    old = {"session": {"spent": [1, 2, 3.0]}, "trainer": {name: own, "envs": envs}}
    new = migrated_checkpoint(old)
    assert new == {"session": {"spent": [1, 2, 3.0]}, "trainer": own, "envs": envs}
    assert migrated_checkpoint(new) == new
    assert set(old["trainer"]) == {name, "envs"}
