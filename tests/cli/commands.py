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


def refusal(capsys, *arguments):
    """What a command says of a mistake: exit code 2, one line, and nothing on standard output."""
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.count("\n") == 1
    return err
