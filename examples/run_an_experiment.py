"""Run the two-wheel experiment from Python and read a signal of its result; the folder also holds system.ssp and result.png."""

import orchestrator

outcome = orchestrator.simulate("two_wheel", "results/two_wheel", stop_time=0.5)
sinkage = orchestrator.open_result(outcome.result).cdl["bcm.diagnostics[1].sinkage"]
print(f"front wheel after {outcome.simulated_s} s: {1e3 * float(sinkage[-1]):.2f} mm deep")
