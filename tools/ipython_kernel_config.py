"""IPython's configuration for the notebooks' kernels; `make setup` copies it into .venv."""

c = get_config()  # noqa: F821
c.InlineBackend.print_figure_kwargs = {"bbox_inches": None}  # a figure is drawn once
c.HistoryManager.enabled = False
c.IPKernelApp.log_level = 40  # no warning that kernels talk on this machine without encryption
