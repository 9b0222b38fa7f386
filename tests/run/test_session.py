import numpy as np
import pytest

from transferkit.budget import Budget, Spent
from transferkit.evaluation import Evaluation
from transferkit.run import CHECKPOINT, Best, EpisodeRow, EvaluationRow, RunDirectory, Schedule, Session, load_state, read_table

TEN = Budget(steps=10)


@pytest.fixture
def session(tmp_path):
    """Makes sessions of one environment, in a directory of their own, with evaluations that score what they are told."""
    made = []

    def make(budget=TEN, num_envs=1, scores=(), **schedule):
        directory = RunDirectory.create(tmp_path / str(len(made)), {})
        made.append(directory)
        means = iter(scores)
        evaluate = lambda _: Evaluation((next(means, 4.0),), (25,))  # noqa: E731
        return Session(directory, budget, num_envs, evaluate=evaluate, schedule=Schedule(**schedule))

    yield make
    for directory in made:
        directory.close()


def step(session, index=0, reward=1.0, *, terminated=False, truncated=False):
    return session.count(index, reward, terminated=terminated, truncated=truncated)


def update(session, **metrics):
    session.after_update(metrics, dict)


def test_steps_and_episodes_of_each_environment_are_booked(session):
    made = session(num_envs=2)
    with made.running():
        for index, reward, ends in ((0, 1.0, {}), (1, 5.0, {}), (0, 2.0, {"terminated": True}), (1, -1.0, {"truncated": True})):
            step(made, index, reward, **ends)
        step(made, 0, 7.0, terminated=True)  # the next episode starts from nothing
    columns = ("episode", "env_index", "return", "length", "terminated", "steps")
    rows = [list(row) for row in zip(*(read_table(made.directory.path, EpisodeRow)[name] for name in columns), strict=True)]
    assert rows == [[1, 0, 3.0, 2, 1, 3], [2, 1, 4.0, 2, 0, 4], [3, 0, 7.0, 1, 1, 5]]
    assert (made.spent.episodes, made.spent.steps) == (3, 5)


def test_the_budget_is_reached_at_its_very_step(session):
    made = session(Budget(steps=3, episodes=9))
    with made.running():
        assert [step(made) for _ in range(3)] == [False, False, True]
    assert made.progress == 1.0
    assert made.step_progress == 1.0


def test_an_evaluation_is_due_once_in_every_interval_and_done_once_at_a_step(session):
    made, evaluated = session(Budget(steps=100), eval_every=4), []
    with made.running():
        for _ in range(3):
            for _ in range(3):
                step(made)
            update(made)
            evaluated.append(made.evaluations)
        assert made.evaluate() == made.evaluate()
    assert evaluated == [0, 1, 2]  # at 3, 6 and 9 steps
    assert read_table(made.directory.path, EvaluationRow)["steps"].tolist() == [6, 9]


def test_the_best_policy_and_the_checkpoint_that_names_it_come_together(session):
    made = session(Budget(steps=100), scores=(1.0, 5.0, 3.0), eval_every=2, checkpoint_seconds=1e9)
    written = []
    with made.running():
        for _ in range(3):
            step(made)
            step(made)
            update(made)
            state = load_state(made.directory.path / CHECKPOINT)["session"]
            written.append((state["spent"][1], state["best"][0]["return_mean"]))
    assert written == [(2, 1.0), (4, 5.0), (4, 5.0)]


def test_an_evaluation_that_is_good_enough_ends_the_run_but_not_the_first(session):
    made = session(Budget(steps=100), scores=(9.0, 1.0, 5.0), eval_every=2, stop_at=5.0)
    with made.running():
        made.evaluate()
        progress = []
        for _ in range(2):
            step(made)
            step(made)
            update(made)
            progress.append(made.progress)
    assert progress == [0.02, 1.0]


def test_the_best_evaluation_is_kept_also_over_a_checkpoint(tmp_path):
    kept = []

    def make(name, scores):
        evaluate = lambda _: Evaluation((next(scores),), (25,))  # noqa: E731
        directory = RunDirectory.create(tmp_path / name, {})
        keep = lambda _: kept.append(made.spent.steps)  # noqa: E731
        made = Session(directory, Budget(steps=99), 1, evaluate=evaluate, keep_best=keep, schedule=Schedule(2))
        return made

    def go_on(made):
        with made.running():
            for _ in range(8):
                step(made)
                update(made)
            made.checkpoint({})
            return load_state(made.directory.path / "checkpoint.safetensors")["session"]

    state = go_on(make("one", iter([1.0, 3.0, 2.0, 3.0])))
    assert kept == [2, 4]  # not what is no better
    made = make("two", iter([2.5, 3.5, 3.0, 3.0]))
    made.restore(state)
    go_on(made)
    assert kept == [2, 4, 12]
    assert made.best == Best(12, 3.5)
    assert made.evaluation_steps == 8 * 25


def test_the_learner_is_behind_until_its_latest_episodes_reach_the_return_to_beat(tmp_path):
    def ended(made, returns):
        behind = []
        with made.running():
            for reward in returns:
                made.count(0, reward, terminated=True, truncated=False)
                behind.append(made.is_behind)
            made.checkpoint({})
        return behind

    make = lambda name, to_beat: Session(  # noqa: E731
        RunDirectory.create(tmp_path / name, {}), Budget(steps=99), 1, evaluate=lambda _: None, to_beat=to_beat
    )
    made = make("one", 3.0)
    assert made.is_behind
    assert ended(made, [9.0, 9.0, 9.0, 9.0, 0.0, -21.0]) == [True] * 4 + [False, True]  # means 7.2 and 1.2
    again = make("two", 3.0)
    again.restore(load_state(made.directory.path / "checkpoint.safetensors")["session"])
    assert again.is_behind
    assert again.latest_return == pytest.approx(1.2)
    assert ended(again, [18.0]) == [False]  # 9, 9, 0, -21, 18: exactly 3
    assert not make("three", None).is_behind


def test_a_learner_with_noise_may_be_a_little_worse_and_does_not_wait_for_five_episodes(tmp_path):
    def make(name, to_beat):
        directory = RunDirectory.create(tmp_path / name, {})
        return Session(directory, Budget(steps=99), 1, evaluate=lambda _: None, to_beat=to_beat, leeway=0.5)

    made, seems = make("one", 3.0), []
    with made.running():
        for reward in (2.4, 2.6, 4.0, 0.0, 0.0, 5.9, 3.0):  # means 2.4, 2.5, 3, 2.25, 1.8, 2.5, 2.58
            made.count(0, reward, terminated=True, truncated=False)
            seems.append((made.seems_behind, made.is_behind))
    assert [seem for seem, _ in seems] == [True, False, False, True, True, False, False]
    assert all(behind for _, behind in seems)
    assert make("two", 3.0).seems_behind is True
    assert make("three", None).seems_behind is None


def test_a_learner_that_keeps_its_peak_is_known_by_it(tmp_path):
    def make(name, **options):
        directory = RunDirectory.create(tmp_path / name, {})
        return Session(directory, Budget(steps=99), 1, evaluate=lambda _: None, to_beat=3.0, falls_back=True, **options)

    made, plain = make("one", keeps_peak=True), make("two")
    told = []
    for one in (made, plain):
        with one.running():
            for reward in (9.0, 9.0, 9.0, 9.0, 0.0, -21.0, 30.0):  # means 7.2, 1.2, 5.4
                one.count(0, reward, terminated=True, truncated=False)
                told.append((one.is_at_peak, one.is_behind, one.plays_core))
            one.checkpoint({})
    early, core = [(True, True, True)] * 4, [(True, False, False)]
    assert told[:7] == [*early, *core, (False, True, False), (False, False, False)]
    assert told[7:] == [*early, *core, (False, True, True), (False, False, False)]
    again = make("three", keeps_peak=True)
    again.restore(load_state(made.directory.path / "checkpoint.safetensors")["session"])
    assert again.peak == made.peak == pytest.approx(7.2)


def test_an_episode_surpasses_the_latest_five_while_it_lasts(tmp_path):
    made, told = Session(RunDirectory.create(tmp_path / "run", {}), Budget(steps=99), 1, evaluate=lambda _: None), []
    with made.running():
        for reward in (9.0, 10.0, 8.0, 7.0, 6.0, 5.0):
            told.append(made.surpasses)
            made.count(0, reward, terminated=True, truncated=False)
        for reward in (9.0, 1.0, 0.5):
            made.count(0, reward, terminated=False, truncated=False)
            told.append(made.surpasses)
    assert told == [True] * 5 + [False] + [False, False, True]  # 10.5 > 10; once there were five, nothing yet is less


def test_the_first_evaluation_ends_no_run_also_if_something_was_charged_before(tmp_path):
    scores, schedule = iter([9.0, 9.0]), Schedule(2, stop_at=5.0)
    evaluate = lambda _: Evaluation((next(scores),), (25,))  # noqa: E731
    directory = RunDirectory.create(tmp_path / "run", {})
    made = Session(directory, Budget(steps=99), 1, evaluate=evaluate, schedule=schedule, charged=Spent(4, 6, 1.5))
    with made.running():
        made.evaluate()
        assert made.progress == 0.0
        step(made)
        step(made)
        update(made)
        assert made.progress == 1.0


def test_what_was_charged_before_training_is_spent_and_the_trainer_sees_what_is_left(tmp_path):
    directory = RunDirectory.create(tmp_path / "run", {})
    budget, charged = Budget(steps=10, episodes=8), Spent(4, 6, 1.5)
    made = Session(directory, budget, 1, evaluate=lambda _: Evaluation((4.0,), (25,)), charged=charged)
    assert (made.progress, made.trained.steps) == (0.0, 0)
    with made.running():
        assert [step(made) for _ in range(2)] == [False, False]
        assert (made.progress, made.trained.steps, made.spent.steps) == (0.5, 2, 8)
        assert [step(made) for _ in range(2)] == [False, True]
        assert (made.progress, made.spent.episodes) == (1.0, 4)
        assert made.spent.seconds >= 1.5


def test_what_is_spent_and_scored_goes_on_from_a_checkpoint(session):
    made = session(num_envs=2, eval_every=2)
    with made.running():
        step(made, 0, 1.0, terminated=True)
        step(made, 1, 2.0)
        update(made)
        made.checkpoint({})
    again = session(num_envs=2, eval_every=2)
    again.restore(load_state(made.directory.path / "checkpoint.safetensors")["session"])
    with again.running():
        assert again.evaluate()["return_mean"] == 4.0
        assert again.evaluations == 1  # at this step it was done before
        step(again, 1, 3.0, truncated=True)
    rows = read_table(again.directory.path, EpisodeRow)
    assert [rows[name].tolist() for name in ("episode", "return", "length", "steps")] == [[2], [5.0], [2], [3]]
    assert again.spent.seconds >= made.spent.seconds


def test_progress_shows_the_mean_of_the_last_returns(tmp_path):
    seen = []
    with RunDirectory.create(tmp_path / "run", {}) as directory:
        made = Session(
            directory,
            Budget(steps=99),
            1,
            evaluate=lambda _: Evaluation((4.0,), (25,)),
            report=lambda spent, metrics: seen.append(dict(metrics)),
        )
        with made.running():
            update(made, loss=0.5)
            for reward in range(60):
                step(made, reward=float(reward), terminated=True)
            update(made, loss=0.25)
    assert seen == [{"loss": 0.5}, {"loss": 0.25, "recent_return": np.mean(range(10, 60))}]
    assert list((tmp_path / "run/tensorboard").iterdir())
