"""`transferkit import`."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser, where_to_find, whole
from transferkit.cli.environment import add_environment, environment
from transferkit.config.checks import AT_LEAST_ONE
from transferkit.errors import ConfigError
from transferkit.zoo.card import NOT_STATED


def main(arguments: Sequence[str]) -> Answer:
    """Make a core of a policy that another library trained."""
    flags = parser(
        "import", "Make a core of a policy of Stable-Baselines3, SBX, rsl_rl, CleanRL or ONNX; its file runs nothing."
    )
    flags.add_argument("file", type=Path, metavar="FILE")
    add_environment(flags, "the environment that it was trained in")
    flags.add_argument("--name", help="of the core, without its version")
    flags.add_argument("--version", type=whole("version", AT_LEAST_ONE), default=1)
    flags.add_argument("--zoo", type=Path, default=Path("zoo"), metavar="FOLDER", help="folder of cores")
    flags.add_argument("--stats", metavar="FILE", help="observation statistics: VecNormalize's pickle or npz; or none")
    flags.add_argument("--activation", help="of its hidden layers, if the file does not say")
    flags.add_argument(
        "--action-scale",
        metavar="SCALE",
        help="the environment's units of an output of 1; or bounds, if -1 to 1 span its bounds",
    )
    flags.add_argument("--descriptor", metavar="FILE", help="what its numbers are: LEAPP YAML or Isaac Lab's IO descriptors")
    flags.add_argument("--std", type=float, help="of exploration, of an action range of [-1, 1]")
    flags.add_argument("--threshold", type=float, metavar="RETURN", help="mean over 20 episodes that it has to reach")
    flags.add_argument("--licence", default=NOT_STATED, help="of the policy")
    options = flags.parse_args(arguments)
    env = environment(options)
    if env is None or options.name is None:
        raise ConfigError("a core needs a name and the environment it was trained in", remedy="give {name} and {env}")
    return _answer(options, env)


def _answer(options: argparse.Namespace, env: str) -> Answer:
    from transferkit.importing import Target, run_import  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.interop import Given  # noqa: PLC0415

    scale = options.action_scale
    if scale not in (None, "bounds"):
        with contextlib.suppress(ValueError):
            scale = float(scale)
    target = Target(options.name, options.version, options.zoo, options.threshold, options.licence)
    done = run_import(
        options.file, env, Given(options.activation, options.stats, scale, options.std, options.descriptor), target
    )
    own, zero = (sum(returns) / len(returns) for returns in (done.returns, done.zero))
    head = f"{target.folder}: {done.library}, return {own:.1f} over {len(done.returns)} episodes, zero action {zero:.1f}"
    lines = [head, *done.notes, *(f"warning: {warning}" for warning in done.warnings), where_to_find(target.folder)]
    data = {
        "id": done.core.id,
        "folder": str(target.folder),
        "library": done.library,
        "components": sorted(done.core.components),
        "score_mean": own,
        "zero_mean": zero,
        "notes": done.notes,
        "warnings": done.warnings,
        "digest": done.core.digest,
    }
    return Answer(data, "\n".join(lines))
