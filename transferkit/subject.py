"""What can be played, evaluated, recorded, distilled or exported: a finished run's policy, or a core."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.config import EnvConfig, TrainConfig
from transferkit.config.checks import check_kind
from transferkit.env_id import EnvId
from transferkit.envs import derive_spec, dims, id_from_file, is_written, opened, written
from transferkit.errors import ConfigError, RunDirectoryError, TransferkitError, UnknownNameError
from transferkit.evaluation import DEFAULT_EPISODES, evaluate
from transferkit.files import damaged_run
from transferkit.job import match_of
from transferkit.nn import Critic, Ensemble, JointInput, StateCritic
from transferkit.policy.critic_and_model import make_critic
from transferkit.policy.make import new_policy, wrap
from transferkit.policy.saved import load_policy, load_saved, policy_file
from transferkit.record.play import Subject
from transferkit.run import named_run, read_made_of, read_record
from transferkit.streams import Streams
from transferkit.tensors import check_enough
from transferkit.zoo.artifact import load_core
from transferkit.zoo.catalog import find_card
from transferkit.zoo.run_core import kept_spec

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.evaluation import Evaluation
    from transferkit.nn import Value
    from transferkit.policy.base import Policy
    from transferkit.policy.saved import SavedPart
    from transferkit.spec import IOSpec


def load_subject(
    name: str,
    *,
    env: EnvLike | None = None,
    member: int | None = None,
    best: bool = False,
    match: str | Path | None = None,
    values: bool = True,
) -> Subject:
    """Load a finished run's policy, or a core: in its own environment, or wrapped onto another one without training.

    Args:
        name: a run directory or one of its policy files, or a core's id or folder.
        env: the environment to play in, in any form; by default the run's, if a record can make it again, or the core's source.
            A run plays as it is where that is its own, perhaps changed, or has the same numbers in the same order, and is
            wrapped as a core elsewhere.
        member: of a core; by default the first.
        best: of a run: the best policy that its evaluations found, instead of the final one.
        match: file that says how it stands on another environment, in place of what is found.
        values: load the critics too, if there are any; if they cannot be rebuilt a warning is logged.

    Raises:
        ConfigError: a run is asked for with a member, or a core for its best; or a match for what plays as it is.
        EnvironmentContractError: the run's environment is not in writing, or needs a module, and none is named.
        UnknownNameError: neither a run nor a core has this name.
    """
    check_kind("name", name, (str, Path), "give a run's folder, or a core's id or folder")
    if (run := named_run(name)) is not None:
        if member is not None:
            raise ConfigError(f"run {name} has no members", remedy="leave out {member}")
        best = best or run[1]
        if env is None or (match is None and _plays_as_it_is(run[0], env)):
            _check_no_match(name, match)
            return _run_subject(run[0], env, best=best, values=values)
        name = str(policy_file(run[0], best=best))
    elif best:
        raise ConfigError(f"{name} is not a run, so it has no best policy", remedy="leave out {best}")
    member = member or 0
    try:
        core = load_core(name, env=env if isinstance(env, str) else None)
    except UnknownNameError as error:
        raise UnknownNameError("run or core", name, error.known, topic=error.topic) from None
    about = {"core": core.id, "core_digest": core.digest, "member": member}
    if env is None or (match is None and env == core.spec.env_id):
        _check_no_match(name, match)
        home = id_from_file(core.spec.env_id, core.id, core.spec.env_id if env else None)
        value = core.critic(member).value if "critic" in core.ensembles else None
        rules = EnvConfig() if Path(name).is_file() else TrainConfig.from_json(find_card(name).config).env_config
        return Subject(core.policy(member), home, value, **asdict(rules), about=about)
    return Subject(wrap(core, env, member=member, match=match), env, wrapped=True, about=about)


def _check_no_match(name: str, match: str | Path | None) -> None:
    if match is not None:
        raise ConfigError(f"{name} plays in its own environment as it is, without {{match}}", remedy="give another {env}")


def _plays_as_it_is(run: Path, env: EnvLike) -> bool:
    """Whether what a run's policy takes and gives means the same in this environment, or it is the run's own."""
    policy, record = load_policy(run), read_record(run)
    own = TrainConfig.from_json(record).env
    with opened(env) as made:
        size, named = dims(made), env if isinstance(env, str) else written(made.env)
    if size != (policy.obs_dim, policy.act_dim):
        return False
    if is_written(named) and is_written(own) and EnvId.read(named).id == EnvId.read(own).id:
        return True
    spec = kept_spec(policy, record)
    if spec is None and not is_written(own):  # of an earlier version, of which nothing is known
        return True
    return (spec or derive_spec(id_from_file(own, run, named))).has_the_numbers_of(derive_spec(env))


def source_spec(name: str) -> IOSpec:
    """The meaning of what a core takes and gives, or a finished run's policy.

    Raises:
        UnknownNameError: neither a run nor a core has this name.
    """
    return load_core(name).spec if named_run(name) else find_card(name).source


def home_of(name: str) -> str:
    """The environment in writing that a run was trained in, or a core's source.

    Raises:
        EnvironmentContractError: it is not in writing, or needs a module.
        UnknownNameError: neither a run nor a core has this name.
    """
    if (run := named_run(name)) is not None:
        return id_from_file(TrainConfig.from_json(read_record(run[0])).env, name)
    return id_from_file(find_card(name).source.env_id, name)


def evaluate_subject(
    subject: Subject,
    *,
    episodes: int = DEFAULT_EPISODES,
    seed: int = 0,
    max_episode_steps: int | None = None,
    report: Callable[[int, int], None] | None = None,
) -> Evaluation:
    """Evaluate a policy in its environment, under the rules that it was trained with."""
    rules = subject.rules
    if max_episode_steps is not None:
        rules["max_episode_steps"] = max_episode_steps
    return evaluate(subject.policy, subject.env, episodes=episodes, seed=seed, report=report, **rules)


def load_value(run_dir: str | Path, policy: Policy, *, best: bool = False) -> Value | None:
    """Load what a finished run's critics think of its policy's actions, in their scale.

    None if it kept no critic, or wrapped one for a policy that it was given ready made.

    Raises:
        RunDirectoryError: a wrapped critic cannot be rebuilt, because its core is not what it was.
    """
    saved, record = load_saved(run_dir, best=best).parts, read_record(Path(run_dir))
    config = TrainConfig.from_json(record)
    with damaged_run(policy_file(run_dir, best=best)):
        if "value" in saved:
            critic = StateCritic(policy.obs_dim, config.network.hidden, config.network.activation, normalizer=policy.normalizer)
            critic.load_state_dict(saved["value"].weights)
            return lambda observation, _: critic.value(observation).squeeze(-1)
        if "critic" not in saved:
            return None
        critics = _critics(config, saved["critic"], read_made_of(record).core_digest, policy, run_dir)
        if critics is not None:
            critics.load_state_dict(saved["critic"].weights)
    return None if critics is None else critics.value


def _critics(config: TrainConfig, saved: SavedPart, digest: str | None, policy: Policy, run_dir: str | Path) -> Critic | None:
    """Build the critics of a policy, or of the core that its run was trained around, with other weights."""
    if architecture := saved.architecture:
        check_enough(saved.weights.values(), architecture.weights, "its critic")
        return Critic(JointInput(policy.normalizer), Ensemble(architecture))
    return None if config.core is None else _wrapped_critic(config, digest, policy, run_dir)


def _wrapped_critic(config: TrainConfig, digest: str | None, policy: Policy, run_dir: str | Path) -> Critic:
    core = load_core(str(config.core), env=config.env)
    if core.digest != digest:
        raise RunDirectoryError(f"core {config.core} is no longer the one that {run_dir} was trained with", remedy="restore it")
    rebuilt = new_policy(config, core, match_of(Path(run_dir)))
    rebuilt.load_state_dict(policy.state_dict())
    return make_critic(rebuilt, config.dyna, config.network.hidden, Streams(0).torch("critic"), wrapped=True)


def _run_subject(run: Path, env: EnvLike | None, *, best: bool, values: bool) -> Subject:
    record = read_record(run)
    config = TrainConfig.from_json(record)
    home = id_from_file(config.env, run) if env is None else env
    policy = load_policy(run, best=best)
    digest = hashlib.sha256(policy_file(run, best=best).read_bytes()).hexdigest()
    training = {name: getattr(config, name) for name in ("algo", "preset", "core", "member", "seed")}
    training["core_digest"] = read_made_of(record).core_digest
    about = {"run": str(run), "policy_sha256": digest, "training": training}
    value = _value(run, policy, best=best) if values else None
    return Subject(policy, home, value, **asdict(config.env_config), about=about)


def _value(run: Path, policy: Policy, *, best: bool) -> Value | None:
    try:
        return load_value(run, policy, best=best)
    except TransferkitError as error:
        logging.getLogger("transferkit").warning("values are not recorded: %s", error)
        return None
