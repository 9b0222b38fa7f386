"""How good is DYNA-DDPG from scratch? Runs over seeds, resumable; writes one CSV row per run.

`python -m experiments.dyna --env Hopper-v5 --episodes 200 --steps 20000 --seeds 0 1 2` goes on where it stopped;
`--set model_share=0.05` changes a setting and `--label` names it; `--summary` prints what the table holds.
"""

from __future__ import annotations

import argparse
import ast
import csv
import itertools
from concurrent.futures import as_completed
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from transferkit import stats
from transferkit.config import DYNA_PRESETS, TrainConfig, preset
from transferkit.envs import make_env
from transferkit.run.directory import read_json, read_table
from transferkit.run.workers import worker_pool
from transferkit.trained import load_policy
from transferkit.transfer import run_training
from transferkit.versions import versions

RESULTS = Path(__file__).parent / "results" / "dyna.csv"
COLUMNS = (
    "label",
    "algo",
    "preset",
    "env",
    "seed",
    "episodes",
    "steps",
    "seconds",
    "eval_return_mean",
    "eval_return_std",
    "eval_episodes",
    "first_solved_steps",
    "worst_after",
    "last_50_mean",
    "speed",
    "commit",
    "mujoco",
    "torch",
)
CURVES = RESULTS.with_name("dyna_curves.csv")
CURVE_COLUMNS = ("label", "algo", "env", "seed", "episodes", "steps", "seconds", "return_mean")
SOLVED = {"InvertedDoublePendulum-v5": 9000.0}
"""Evaluation return from which on a collapse is looked for."""

SPEED_EPISODES = 5


def main() -> None:
    """Train the runs that the table lacks, and add them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--env")
    parser.add_argument("--seeds", type=int, nargs="*", default=[])
    parser.add_argument("--algo", default="dyna-ddpg", choices=["dyna-ddpg", "dyna-ppo"])
    parser.add_argument("--preset", default="default", choices=list(DYNA_PRESETS))
    parser.add_argument("--episodes", type=int)
    parser.add_argument("--steps", type=int)
    parser.add_argument("--eval-every", type=int, default=0)
    parser.add_argument("--label", default="default")
    parser.add_argument("--set", nargs="*", default=[], metavar="FIELD=VALUE")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--summary", action="store_true")
    options = parser.parse_args()
    names = "label", "algo", "preset", "env", "seed"
    known = {tuple(row[name] for name in names) for row in rows()}
    which = options.label, options.algo, options.preset, options.env
    jobs = [seed for seed in options.seeds if (*which, str(seed)) not in known]
    with worker_pool(options.workers, len(jobs)) as pool:
        for done in as_completed([pool.submit(run, options, seed) for seed in jobs]):
            add(done.result())
    if options.summary or not jobs:
        summarise()


def run(options: argparse.Namespace, seed: int) -> dict:
    """One run and its row."""
    config = preset(TrainConfig(options.env, algo=options.algo, seed=seed), options.preset)
    dyna = replace(config.dyna, **dict(setting(text) for text in options.set))
    config = replace(config, steps=options.steps, episodes=options.episodes, eval_every=options.eval_every, dyna=dyna)
    out = Path("runs/dyna") / f"{options.label}_{options.algo}_{options.env.replace('/', '-')}_seed{seed}"
    result = asdict(run_training(config, out=out, resume=True))
    print(f"{options.label} {options.env} seed {seed}: {result['eval_return_mean']:.1f}", flush=True)
    evaluations, episodes = read_table(out, "evaluations"), read_table(out, "episodes")
    solved = [row for row in evaluations if row["return_mean"] >= SOLVED.get(options.env, np.inf)]
    after = [row["return_mean"] for row in evaluations if solved and row["steps"] >= solved[0]["steps"]]
    return result | {
        "label": options.label,
        "curve": evaluations,
        "first_solved_steps": int(solved[0]["steps"]) if solved else "",
        "worst_after": round(min(after), 1) if after else "",
        "last_50_mean": round(float(np.mean([row["return"] for row in episodes[-50:]])), 2),
        "speed": forward_speed(out, options.env),
        "commit": (read_json(out / "run.json")["git"] or {}).get("commit", ""),
        **{name: versions()[name] for name in ("mujoco", "torch")},
    }


def setting(text: str) -> tuple[str, object]:
    """`FIELD=VALUE`, the value as Python reads it, or as it stands."""
    name, _, value = text.partition("=")
    try:
        return name, ast.literal_eval(value)
    except (SyntaxError, ValueError):
        return name, value


def forward_speed(out: Path, env_id: str) -> float | str:
    """Mean forward speed in m/s over deterministic episodes, where the environment reports it."""
    env, policy, speeds = make_env(env_id), load_policy(out), []
    for seed in range(SPEED_EPISODES):
        observation, _ = env.reset(seed=seed)
        for _ in itertools.count():
            observation, _, terminated, truncated, info = env.step(policy.act(observation[None])[0])
            if "x_velocity" not in info:
                return ""
            speeds.append(info["x_velocity"])
            if terminated or truncated:
                break
    return round(float(np.mean(speeds)), 3)


def rows() -> list[dict]:
    """The table so far."""
    return list(csv.DictReader(RESULTS.open())) if RESULTS.exists() else []


def add(row: dict) -> None:
    """Append a run, and its evaluations during training."""
    which = {name: row[name] for name in ("label", "algo", "env", "seed")}
    append(CURVES, CURVE_COLUMNS, [{**point, **which, "return_mean": round(point["return_mean"], 1)} for point in row["curve"]])
    append(RESULTS, COLUMNS, [row])


def append(path: Path, columns: tuple[str, ...], new: list[dict]) -> None:
    """Add rows to a table."""
    empty = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore", lineterminator="\n")
        if empty:
            writer.writeheader()
        writer.writerows(new)


def summarise() -> None:
    """Interquartile means with intervals over seeds."""
    key = lambda row: (row["env"], row["algo"], row["label"])  # noqa: E731
    for (env, algo, label), group in itertools.groupby(sorted(rows(), key=key), key):
        runs = list(group)
        values = [float(row["eval_return_mean"]) for row in runs]
        low, high = stats.iqm_interval(values)
        print(
            f"{env} {algo} {label}: IQM {stats.iqm(values):.0f} ({low:.0f} to {high:.0f}), n {len(values)}, "
            f"steps {runs[0]['steps']}, seconds {np.mean([float(row['seconds']) for row in runs]):.0f}; "
            + ", ".join(f"{value:.0f}" for value in sorted(values))
        )


if __name__ == "__main__":
    main()
