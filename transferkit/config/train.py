"""Settings of a whole run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Annotated, Any, Literal

from transferkit.config.checks import AT_LEAST_ONE, EPISODES, NOT_NEGATIVE, POSITIVE, Seed, check, check_kind, check_value
from transferkit.config.dyna import DynaConfig, DynaPPOConfig, ModelConfig
from transferkit.config.env import EnvConfig
from transferkit.config.migrate import migrated
from transferkit.config.network import NetworkConfig
from transferkit.config.ppo import PPOConfig
from transferkit.config.presets import PRESETS, SECTIONS, USED, Algorithm, closest_preset, preset_version
from transferkit.config.wrap import WrapConfig, check_asked, check_found
from transferkit.errors import ConfigError, SettingError, UnknownNameError

FROM_PRESET: Any = None
"""A section that is left out is filled in from the preset."""

DETERMINED_BY = (
    "env",
    "seed",
    "episodes",
    "steps",
    "seconds",
    "eval_episodes",
    "eval_every",
    "stop_at",
    "experience",
    "mapping",
    "match",
)
"""Fields besides the settings that determine a run's numbers."""

BEGINNING = tuple(f"network.{name}" for name in ("std", "init_std", "squash", "normalize_observation"))
"""Settings that make a policy from scratch and that nothing else reads."""


@dataclass(frozen=True)
class TrainConfig:
    """Everything that determines a training run."""

    env: str
    """Environment: an id, an id with arguments `ID?NAME=VALUE`, MODULE:ID or MODULE:FUNCTION."""
    core: str | None = None
    """Core id or folder, or the directory of a finished run; None trains from scratch."""
    member: Annotated[int, NOT_NEGATIVE] = 0
    """Which of the core's source seeds."""
    match: str | None = None
    """File of a match of the core and the environment, from `transferkit match`, in place of the one that is found."""
    algo: Algorithm = "ppo"
    """Trainer."""
    preset: str = "default"
    """Settings to start from: `default`, `paper`, or one version of them, such as `default-v1`."""
    seed: Seed = 0
    """Seed of every random stream."""
    episodes: Annotated[int, AT_LEAST_ONE] | None = None
    """Budget in completed episodes."""
    steps: Annotated[int, AT_LEAST_ONE] | None = None
    """Budget in environment steps."""
    seconds: Annotated[float, POSITIVE] | None = None
    """Budget in seconds of training."""
    eval_episodes: Annotated[int, EPISODES] = 20
    """Episodes of an evaluation."""
    eval_every: Annotated[int, NOT_NEGATIVE] = 0
    """Environment steps between evaluations, the first before any training; 0 evaluates at the end only."""
    stop_at: float | None = None
    """Mean return of an evaluation, after the first one, that ends training before the budget does."""
    checkpoint_seconds: Annotated[float, NOT_NEGATIVE] = 20.0
    """Least time between checkpoints."""
    device: str = "cpu"
    """Torch device of the networks, `cpu` or `cuda`."""
    compile: Literal["auto", "on", "off"] = "auto"
    """Compile updates with a C++ compiler: `auto` does on a CPU if the budget pays for it. The results differ by rounding.
    DYNA-DDPG's on a CUDA device are replayed as graphs instead, with the same results."""
    experience: tuple[str, ...] = ()
    """dyna-ddpg: recordings (FILE.mcap) and Minari datasets (minari:NAME) to learn from before the first real step."""
    mapping: str | None = None
    """TOML file that names the channels of other tools' recordings."""
    env_config: EnvConfig = FROM_PRESET
    """How the policy meets the environment."""
    network: NetworkConfig = FROM_PRESET
    """The network without a core."""
    ppo: PPOConfig = FROM_PRESET
    """PPO's settings."""
    dyna: DynaConfig = FROM_PRESET
    """DYNA-DDPG's settings."""
    dyna_ppo: DynaPPOConfig = FROM_PRESET
    """DYNA-PPO's settings, beside PPO's."""
    model: ModelConfig = FROM_PRESET
    """The learnt model's settings, for DYNA-DDPG and DYNA-PPO."""
    wrap: WrapConfig = FROM_PRESET
    """The sandwich's settings."""

    def __post_init__(self) -> None:
        check_value("algo", self.algo, str)
        check_value("preset", self.preset, str)
        version = preset_version(self.algo, self.preset)
        object.__setattr__(self, "preset", version)
        for name in SECTIONS:
            if getattr(self, name) is FROM_PRESET:
                object.__setattr__(self, name, getattr(PRESETS[self.algo][version], name))
            kind = type(getattr(PRESETS[self.algo][version], name))
            check_kind(name, getattr(self, name), kind, f"make one: {kind.__name__}()")
        check(self)
        _check_combinations(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> TrainConfig:
        """Read the configuration of a record, of this version or of an earlier one; what else is recorded is left out.

        Raises:
            ConfigError: a field is missing, or no version knows it.
        """
        try:
            data = migrated(data)
            sections = {name: _section(name, data[name]) for name in SECTIONS}
            plain = {f.name: data[f.name] for f in fields(cls) if f.name in data}
            plain["preset"] = closest_preset(data["algo"], data["preset"], sections)
            return cls(**_tuples(plain | sections))
        except (LookupError, TypeError, AttributeError, ValueError) as error:
            raise ConfigError(f"the record does not hold a configuration of this version ({error})") from None


def overrides(config: TrainConfig) -> dict[str, Any]:
    """The settings that the run reads and that differ from its preset, by dotted name, JSON-ready."""
    preset, changed = PRESETS[config.algo][config.preset], {}
    for section in USED[config.algo]:
        if section == "wrap" and config.core is None:
            continue
        own, given = (asdict(getattr(side, section)) for side in (config, preset))
        changed |= {f"{section}.{name}": _listed(value) for name, value in own.items() if value != given[name]}
    return changed


def identity(config: TrainConfig) -> dict[str, Any]:
    """What determines the run's numbers, JSON-ready: its preset's version and overrides, budget, seed and evaluation.

    Settings that the run does not read, and options that are not used, are left out.
    """
    plain = {name: _listed(getattr(config, name)) for name in DETERMINED_BY}
    core = {"core": config.core, "member": config.member} if config.core is not None else {}
    device = {"device": config.device} if config.device != "cpu" else {}
    settings = {"algo": config.algo, "preset": config.preset, "overrides": overrides(config)}
    return {name: value for name, value in (plain | core | device | settings).items() if value not in (None, [], {})}


def with_settings(config: TrainConfig, settings: Mapping[str, Any]) -> TrainConfig:
    """The configuration with settings by dotted name, such as `{"ppo.gamma": 0.98}`; `"none"` stands for None.

    Raises:
        ConfigError: a name is none.
        UnknownNameError: there is no such setting.
        SettingError: a value does not fit.
    """
    changed: dict[str, dict[str, Any]] = {}
    for name, value in settings.items():
        check_kind("a setting's name", name, str, "give them by name, such as {'ppo.gamma': 0.98}")
        section, _, key = name.partition(".")
        if section not in SECTIONS or key not in getattr(config, section).__dataclass_fields__:
            known = [f"{part}.{key}" for part in SECTIONS for key in getattr(config, part).__dataclass_fields__]
            raise UnknownNameError("setting", name, known)
        changed.setdefault(section, {})[key] = tuple(value) if isinstance(value, list) else None if value == "none" else value
    # All of a section at once: one setting may need another.
    return replace(config, **{section: replace(getattr(config, section), **own) for section, own in changed.items()})


def check_read(config: TrainConfig, names: Iterable[str], *, ready: bool = False) -> None:
    """Refuse settings, by dotted name, that the run does not read: of another trainer, or of another way to make the policy.

    Args:
        config: the run.
        names: the settings that were given.
        ready: whether the policy is made already.

    Raises:
        ConfigError: a setting has no effect.
    """
    if config.member and config.core is None:
        raise ConfigError(f"{{member={config.member}}} has no effect without a core", remedy="give {core}, or leave it out")
    if config.match and config.core is None:
        raise ConfigError(f"{{match={config.match}}} has no effect without a core", remedy="give {core}, or leave it out")
    of_wrap = [name.removeprefix("wrap.") for name in names if name.startswith("wrap.")]
    check_found(of_wrap, config.wrap, config.match)
    check_asked(of_wrap, config.wrap)
    for name in names:
        section, _, key = name.partition(".")
        if section not in USED[config.algo]:
            others = [f"{{{own}.{key}}}" for own in USED[config.algo] if key in getattr(config, own).__dataclass_fields__]
            remedy = f"did you mean {' or '.join(others)}?" if others else "leave it out"
            raise ConfigError(f"{{{name}}} is not a setting of {config.algo}", remedy=remedy)
        if ready and (section == "wrap" or name in BEGINNING):
            raise ConfigError(f"{{{name}}} has no effect on a policy that is made", remedy="give it where the policy is made")
        if section == "wrap" and config.core is None:
            raise ConfigError(f"{{{name}}} has no effect without a core", remedy="give {core}, or leave it out")
        if name in BEGINNING and config.core is not None:
            raise ConfigError(f"{{{name}}} has no effect on a core", remedy="leave it out, or leave out {core}")


def _section(name: str, data: Mapping[str, Any]) -> Any:  # noqa: ANN401 - one of the sections
    return type(getattr(PRESETS["ppo"]["default-v2"], name))(**_tuples(data))


def _tuples(data: Mapping[str, Any]) -> dict[str, Any]:
    return {name: tuple(value) if isinstance(value, list) else value for name, value in data.items()}


def _listed(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value


def _check_combinations(config: TrainConfig) -> None:
    if config.stop_at is not None and not config.eval_every:
        raise ConfigError(f"{{stop_at={config.stop_at:g}}} is compared with evaluations", remedy="give {eval_every} too")
    if config.experience and config.algo != "dyna-ddpg":
        raise ConfigError(f"{config.algo} does not learn from recordings", remedy="use {algo=dyna-ddpg}, or no {experience}")
    if config.mapping and not config.experience:
        raise ConfigError(f"{{mapping={config.mapping}}} has no recordings to read", remedy="give {experience} too")
    if config.model.loss == "squared-error":
        _check_squared_error(config)


def _check_squared_error(config: TrainConfig) -> None:
    """The paper's model learns neither rewards nor terminations."""
    learns = config.dyna.planned_reward == "learned" or config.dyna.planned_termination
    if config.algo == "dyna-ppo" or (config.algo == "dyna-ddpg" and learns):
        raise SettingError(
            "model.loss",
            value=config.model.loss,
            allowed="'likelihood', which learns rewards and terminations",
            remedy="for dyna-ddpg set {dyna.planned_reward=minus-norm} and {dyna.planned_termination=False} instead",
        )
