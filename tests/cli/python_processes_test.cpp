// Python's module in threads that outlive the script, and in processes that were forked.
#include "tests/cli/python_program.h"

#ifdef CLOAM_PYTHON

using namespace cloam;
using namespace python_program;

TEST_CASE("python: a thread that computes does not disturb the end of Python") {
  for (int i = 0; i < 3; ++i) {
    const Outcome outcome = python(R"(
import time
def compute():
    while True: (cloam.tensor([1.0, 2.0]) * 2).numpy()
for _ in range(2): threading.Thread(target=compute, daemon=True).start()
time.sleep(1)
)");
    CHECK_MESSAGE(outcome.code == 0, outcome.out);
    CHECK(outcome.out.empty());
  }
}

TEST_CASE("python: a forked process is told to be started anew") {
  CHECK(printed(R"(
import os, signal
x = cloam.tensor([1.0, 2.0])
held = (x * 2).numpy()
child = os.fork()
if child == 0:
    signal.alarm(20)  # what it is to be told comes at once
    try: (x * 3).numpy()
    except cloam.Error as error: os._exit(7 if error.fault == cloam.Fault.device and "spawn" in str(error) else 1)
    os._exit(2)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
assert (x * 3).numpy().tolist() == [3, 6] and held.tolist() == [2, 4]
print("well")
)") == "well\n");
}

TEST_CASE("python: a forked process ends with its own exit code, and with what it has printed") {
  CHECK(printed(R"(
import atexit, os, signal, sys
child = os.fork()
if child == 0:
    signal.alarm(20)
    atexit.register(print, "the child's handler")
    print("the child")
    sys.exit(9)
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
print(code)
)") == "the child\nthe child's handler\n9\n");
}

#endif
