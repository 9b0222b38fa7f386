"""Recordings of episodes as MCAP files: written, read, replayed, learnt from."""

from transferkit.record.datasets import export_minari
from transferkit.record.experience import load_experience
from transferkit.record.format import Names
from transferkit.record.play import Played, Subject, record_episodes, record_evaluation
from transferkit.record.reader import Contents, Transitions, read, read_transitions, spec_of
from transferkit.record.recover import recover
from transferkit.record.replay import OnFrame, Replayed, replay_recording

__all__ = [
    "Contents",
    "Names",
    "OnFrame",
    "Played",
    "Replayed",
    "Subject",
    "Transitions",
    "export_minari",
    "load_experience",
    "read",
    "read_transitions",
    "record_episodes",
    "record_evaluation",
    "recover",
    "replay_recording",
    "spec_of",
]
