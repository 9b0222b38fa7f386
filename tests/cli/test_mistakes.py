"""What nobody would give a command on purpose: each is one line and exit code 2, and writes nothing."""

import os
import subprocess
import sys

import pytest

from tests.cli.commands import refusal

CORE = "inverted-pendulum-v1"
TRAIN = "train --env Hopper-v5 --steps 9"
PRETRAIN = "pretrain --env Hopper-v5 --steps 9 --threshold 1"
HUGE = "1" + "0" * 400
INT64 = "at most 9,223,372,036,854,775,807"

NUMBERS = {
    f"train --env Hopper-v5 --steps {HUGE}": f"... must be {INT64}",
    "train --env Hopper-v5 --seconds nan": "--seconds=nan must be a finite number",
    f"{TRAIN} --seed {2**63}": f"--seed={2**63} must be {INT64}",
    f"{TRAIN} --eval-every 5 --stop-at inf": "--stop-at=inf must be a finite number",
    f"{TRAIN} --member 5": "--member 5 has no effect without a core; give --core",
    f"{TRAIN} --network.hidden 1000000000": "=(1000000000,) must be a list, each item at least 1 and at most 8,192",
    f"{TRAIN} --network.hidden {'8 ' * 17}": "must be at least one number and at most 16",
    f"{TRAIN} --ppo.num-envs 1000000": "--ppo.num-envs=1000000 must be at least 1 and at most 1,024",
    f"{TRAIN} --algo dyna-ddpg --model.members 1000": "--model.members=1000 must be at least 1 and at most 64",
    f"{TRAIN} --algo dyna-ddpg --dyna.buffer-size {10**12}": "must be at least 1 and at most 100,000,000",
    f"{TRAIN} --algo dyna-ddpg --dyna.reward-scale nan": "--dyna.reward-scale=nan must be a finite number",
    f"{TRAIN} --core {CORE} --wrap.residual 1000000": "--wrap.residual=1000000 must be at least 0 and at most 8,192",
    f"{TRAIN} --core {CORE} --wrap.hold 20000": "--wrap.hold=20000 must be at least 0 and at most 10,000",
    f"match {CORE} Hopper-v5 --hold 99999": "--hold=99999 must be at least 0 and at most 10,000",
    f"match {CORE} Hopper-v5 --stagger nan": "--stagger=nan must be a finite number",
    f"{TRAIN} --record every=²": "--record='every=²' must be every=N",
    "eval x --episodes 0": "--episodes=0 must be at least 1 and at most 1,000,000",
    f"eval x --seed {HUGE}": f"... must be {INT64}",
    "play x --out x.mp4 --seconds 0": "--seconds=0 must be at least 1 and at most 3,600",
    "play x --member -1": "--member=-1 must be at least 0",
    "record x --out x.mcap --episodes -1": "--episodes=-1 must be at least 1",
    "export x --out x.onnx --member -1": "--member=-1 must be at least 0",
    "plot x.mcap --episode -1": "--episode=-1 must be at least 0",
    f"quickstart --seed {2**64}": f"--seed={2**64} must be {INT64}",
    f"{PRETRAIN} --name x --workers 0": "--workers=0 must be at least 1",
    f"{PRETRAIN} --name x --version 0": "--version=0 must be at least 1",
    f"{PRETRAIN} --name x --seeds 1 1": "--seeds=(1, 1) must be different from each other",
    "pretrain --env Hopper-v5 --steps 9 --name x --threshold nan": "--threshold=nan must be a finite number",
}
WORDS = {
    "eval x --sed 1": "unknown flag '--sed'; did you mean --seed",
    "eval x --episodes ten": "--episodes='ten' must be a whole number",
    "eval x more": "unexpected argument 'more'",
    "eval": "required: RUN|CORE; `--help` explains the flags",
    "play": "required: RUN|CORE; `--help` explains the flags",
    "play x --input": "unknown flag '--input'; did you mean --inputs or",
    "record x --ot x.mcap": "unknown flag '--ot'; did you mean --out or",
    "zoo lst": "unknown action 'lst'; did you mean list?",
    "--jsn": "unknown flag '--jsn'; did you mean --json?",
    "train --hlp": "unknown flag '--hlp'",
    f"{TRAIN} more": "unexpected argument 'more'",
    f"{TRAIN} --wrap.lr-scale core 1": "did you mean --wrap.lr-scale.core",
    "train --env": "--env needs a value",
    f"{TRAIN} --network.hidden x 2": "--network.hidden='x 2' must be a list, each item a whole number",
    f"{TRAIN} --ppo.critic-learning-rate=x": "--ppo.critic-learning-rate='x' must be a number",
    f"{TRAIN} --wrap.freeze core": "--wrap.freeze='core' must be a table of names and values",
    "pretrain --threshld 1": "unknown flag '--threshld'; did you mean --threshold",
}
NO_EFFECT = {
    f"{TRAIN} --algo dyna-ddpg --ppo.gamma 0.5": "--ppo.gamma is not a setting of dyna-ddpg; did you mean --dyna.gamma?",
    f"{TRAIN} --model.updates 9": "--model.updates is not a setting of ppo; leave it out",
    f"{TRAIN} --wrap.no-finetune": "--wrap.finetune has no effect without a core",
    f"{TRAIN} --core {CORE} --network.std head": "--network.std has no effect on a core",
    f"{PRETRAIN} --name x --wrap.residual 0": "--wrap.residual has no effect without a core",
    f"{TRAIN} --core {CORE} --match file --wrap.hold 5": "--wrap.hold has no effect on a --match that is given",
    f"{TRAIN} --core {CORE} --wrap.adapter pad --wrap.forces load": "--wrap.forces has no effect on --wrap.adapter pad",
    f"{TRAIN} --core {CORE} --preset paper --wrap.limbs all": "--wrap.limbs has no effect on --wrap.structure paper",
    f"{TRAIN} --core {CORE} --trust-core --wrap.probation 3": "--trust-core is --wrap.probation 0, not 3",
    f"{TRAIN} --core {CORE} --trust-core --wrap.least-gain 0.5": "--wrap.least-gain has no effect without probation",
    "export x.mcap --minari x/y-v0 --member 1": "--member, --best and --match are of a policy; give --out, or leave them out",
    "plot . --episode 1": "--episode and --mapping are of a recording, and this is a run; leave them out",
    f"zoo verify --all {CORE}": f"--all is every core, and {CORE} is named; leave one of them out",
    f"distill {CORE} --env Hopper-v5 --name x --members 9": f"--members=9 must be 0 to 4 for core {CORE}",
    f"zoo pull {CORE}": "no zoo was added; `transferkit zoo add URL` adds one",
}
PLACES = {
    f"{PRETRAIN} --name ../x": "--name='../x' must be letters, digits",
    f"{PRETRAIN} --name .x": "--name='.x' must be letters, digits",
    f"{PRETRAIN} --name=-x": "--name='-x' must be letters, digits",
    f"{PRETRAIN} --name {'x' * 81}": "must be letters, digits, '_', '-' and '.', at most 80",
    f"{PRETRAIN} --name x --zoo file/zoo": "file is not a folder; choose another --zoo",
    f"{TRAIN} --out file": "file is not a folder; choose another --out",
    f"{TRAIN} --out file/run": "file is not a folder; choose another --out",
    "quickstart --out file": "file is not a folder; choose another --out",
    "play x --out x.gif": "ending of x.gif='.gif' must be .mp4 or .png; choose another --out",
    "play x --out no/x.mp4": "cannot write no/x.mp4: no folder no; choose an --out in a folder that exists",
    "record x --out x.txt": "ending of x.txt='.txt' must be .mcap",
    "export x --out x.txt": "ending of x.txt='.txt' must be .onnx",
    "export x.mcap --out x.onnx": "x.mcap is a recording and not a policy; write it as a dataset with --minari",
    "export x.mcap --minari ../x-v0": "Minari dataset='../x-v0' must be a name with a version",
    "recover x.mcap --out x.txt": "ending of x.txt='.txt' must be .mcap",
    f"{TRAIN} --out \udcff": r"this locale cannot read the argument '\udcff'; set PYTHONUTF8=1",
}


@pytest.mark.parametrize(("arguments", "message"), (NUMBERS | WORDS | NO_EFFECT | PLACES).items(), ids=lambda text: text[:60])
def test_a_mistake_is_one_line_and_writes_nothing(capsys, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    said = refusal(capsys, *arguments.split())
    assert message in said
    assert len(said) < 400
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_setting_is_none_as_in_a_grid(capsys):
    for none in ("--ppo.max-grad-norm none", "--ppo.max-grad-norm=none"):
        assert "no budget given" in refusal(capsys, *f"train --env Hopper-v5 {none}".split())


@pytest.mark.parametrize(
    ("command", "code", "message"),
    [
        ("zoo list >/dev/full", 2, "transferkit: No space left on device\n"),
        ("zoo list >&-", 0, ""),
        ("zoo list >&- 2>&- <&-", 0, ""),
        ("zoo lst 2>/dev/full", 2, ""),
        (
            "zoo show ü",
            2,
            "transferkit: this locale cannot read the argument '\\udcc3\\udcbc'; set PYTHONUTF8=1, or use ASCII\n",
        ),
    ],
)
def test_output_that_cannot_be_written_is_no_traceback(command, code, message):
    plain = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    line = f"{sys.executable} -m transferkit {command}"
    done = subprocess.run(["sh", "-c", line.encode()], env=plain, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, message)
