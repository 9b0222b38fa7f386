from tests.cli.commands import run_json


def test_doctor(capsys):
    report = run_json(capsys, "doctor")
    assert {"versions", "problems"} <= set(report)
