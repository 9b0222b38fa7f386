"""Commands run in this process."""

import json

from transferkit.cli.main import main


def run(capsys, *arguments):
    """Exit code, stdout and stderr of a command."""
    code = main([str(argument) for argument in arguments])
    output = capsys.readouterr()
    return code, output.out, output.err


def run_json(capsys, *arguments):
    """What a command that succeeds answers as JSON."""
    code, out, err = run(capsys, *arguments, "--json")
    assert code == 0, err
    return json.loads(out)
