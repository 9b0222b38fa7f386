import signal
import threading

import pytest

from transferkit.run.stop_signals import stop_signals


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_first_signal_asks_and_a_second_one_stops_at_once(number):
    before = signal.getsignal(number)
    with stop_signals() as request:
        assert not request.made
        signal.raise_signal(number)
        assert request.made
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert signal.getsignal(number) is before


def test_handlers_come_back_after_an_error():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(ValueError, match="within"), stop_signals():
        raise ValueError("within")
    assert signal.getsignal(signal.SIGTERM) is before


def test_in_a_thread_nothing_changes():
    found = []

    def work():
        with stop_signals() as request:
            found.append((request.made, signal.getsignal(signal.SIGINT)))

    before = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [(False, before)]
