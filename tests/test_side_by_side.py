"""Jobs in processes side by side, whatever becomes of each."""

import pytest

from orchestrator.side_by_side import Crew


def results(size, *expressions):
    """What expressions come to, and why those that fail do; and what was said when."""
    answers, said = {}, []

    def finished(i, answer, error):
        answers[i] = error or answer
        said.append(f"{i} done")

    with Crew(size) as crew:
        crew.work(eval, [(text,) for text in expressions], lambda i: said.append(f"{i} started"), finished)
    return [answers[i] for i in range(len(expressions))], said


@pytest.mark.parametrize("size", [1, 2])
def test_a_job_that_fails_leaves_the_others_alone(size):
    answers, _ = results(size, "1 + 1", "1 / 0", "2 + 2")
    assert answers == [2, "ZeroDivisionError: division by zero", 4]


def test_a_process_that_ends_takes_none_of_the_jobs_after_it_along():
    answers, _ = results(2, "__import__('os')._exit(1)", "__import__('time').sleep(1.0)", "2 + 2", "3 + 3")
    assert answers[0].startswith("its process ended: ") and answers[2:] == [4, 6]


def test_jobs_are_said_to_start_when_they_do():
    assert results(1, "1", "2")[1] == ["0 started", "0 done", "1 started", "1 done"]
    assert results(2, "1", "2", "3")[1][:3] in (["0 started", "1 started", "0 done"], ["0 started", "1 started", "1 done"])


def test_an_interrupt_ends_the_processes():
    with pytest.raises(KeyboardInterrupt), Crew(2) as crew:
        crew.work(eval, [("1",), ("__import__('time').sleep(60)",)], lambda i: None, interrupt)


def interrupt(*finished):
    raise KeyboardInterrupt
