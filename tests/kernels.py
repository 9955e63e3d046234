"""Kernels of the notebooks that are tested, forked from a process that has imported what they use.

Each has a namespace of its own, as in a new process; the imports take half of a short notebook.
"""

import multiprocessing
import os
import sys
import threading
import time

FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["ipykernel.kernelapp", "d2d.study.book.style", "scipy.integrate"])


class ForkedKernel(FORKS.Process):
    """The process of a kernel, with what Jupyter uses of `subprocess.Popen`."""

    stdin = stdout = stderr = None

    def __init__(self, command, *, cwd, env, **_):
        super().__init__(target=run, args=(command[command.index("-f") :], cwd, env), daemon=True)
        self.start()
        while os.getpgid(self.pid) != self.pid:  # which Jupyter ends as a group
            time.sleep(1e-3)

    def poll(self):
        return self.exitcode

    def wait(self):
        self.join()
        return self.exitcode


def run(options, folder, environment):
    """Turn a fork into a kernel, which ends with the process of the tests."""
    import matplotlib
    from ipykernel.kernelapp import IPKernelApp

    os.setsid()
    os.chdir(folder)
    os.environ.update(environment)
    sys.path[:] = [entry for entry in sys.path if not entry.endswith("tools")]
    matplotlib.rcParams["backend"] = "module://matplotlib_inline.backend_inline"
    tests = multiprocessing.parent_process()
    threading.Thread(target=lambda: (tests.join(), os._exit(1)), daemon=True).start()
    IPKernelApp.launch_instance(argv=[*options, f"--IPKernelApp.parent_handle={os.getppid()}"])
