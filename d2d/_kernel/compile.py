"""Decorators that compile the functions of the kernel, and the cache of the compiled code.

- ``compiled``: compiled as a function of its own
- ``inlined``: compiled, then copied into its callers
- ``vectorised``: the same, for loops over the lanes, in which products and sums may be fused
- ``entry``: called from Python, without the GIL, and kept on disk where a folder is writable

None of them counts references (``_nrt``): where arrays are passed in tuples, counting costs as much
as a small problem.  So no function of the kernel allocates memory.

With ``NUMBA_DISABLE_JIT=1`` all of it runs as Python, slowly, but line by line in a debugger.
"""

import gc
import hashlib
import warnings
from collections.abc import Callable
from functools import cache, wraps
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numba import config, njit
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.typed_passes import InlineOverloads, NopythonRewrites
from numba.core.types import Function
from numba.core.typing import Context
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables
from numpy.typing import NDArray

# Products and sums may be fused, but not reordered: LLVM reorders them in one way in the process
# that compiles and in another in the code that is cached.  NaN is assumed not to occur ("nnan"), so
# that minima and maxima are single instructions.
FAST = {"contract", "nnan"}


def _nothing(*args: Any) -> int:
    """Return null, the address of no function."""
    return 0


class _LinkedLibrary(JITCodeLibrary):  # type: ignore[misc]
    """The code of a part, which is optimised and translated where it is linked, not by itself."""

    codegen = property(lambda self: self)  # which Numba only asks to `set_env`
    _optimize_final_module = get_pointer_to_function = set_env = _nothing

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _TypingContext(Context):  # type: ignore[misc]
    """Numba's own context, in which an operator or a function is resolved once for some types.

    At every place where it stands, and in every round anew, took a third of the first call.
    """

    known: ClassVar[dict[tuple[Any, ...], Any]] = {}

    def __init__(self, shared: Context) -> None:
        self.__dict__ = vars(shared)

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        builtin = self._lookup_global(func) or func
        if not isinstance(builtin, Function):
            return super().resolve_function_type(func, args, kws)
        key = builtin, args, tuple(dict(kws).items())
        if key not in self.known:
            self.known[key] = super().resolve_function_type(func, args, kws)
        return self.known[key]


class _KernelCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler, without closures, array expressions and merging, which LLVM does faster."""

    def __init__(self, typingctx: Context, *state: Any) -> None:
        super().__init__(typingctx, *state)
        self.state.typingctx = _TypingContext(typingctx)

    def define_pipelines(self) -> list[Any]:
        (pipeline,) = super().define_pipelines()
        superfluous = InlineClosureLikes, InlineInlinables, InlineOverloads, NopythonRewrites
        pipeline.passes = [each for each in pipeline.passes if each[0] not in superfluous]
        pipeline._ENFORCING = False  # Numba's check of itself, after every pass
        return [pipeline]


class _PartCompiler(_KernelCompiler):
    def __init__(self, typingctx: Context, targetctx: Any, *state: Any) -> None:
        super().__init__(typingctx, targetctx, *state)
        self.state.library = _LinkedLibrary(targetctx.codegen(), "part")


def part(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator for functions that only compiled ones call: linked, without a wrapper.

    Wrappers for Python and code of its own for each take a quarter of the time of the first call.
    """
    options |= {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compile_part = njit(error_model="numpy", _nrt=False, pipeline_class=_PartCompiler, **options)

    def compiling(function: Callable[..., Any]) -> Any:
        dispatcher = compile_part(function)
        if not config.DISABLE_JIT:
            dispatcher._insert = lambda *compiled: None  # there is nothing that Python could call
            dispatcher._compile_for_args = lambda *args: function  # Python runs it uncompiled
        return dispatcher

    return compiling


# A function hands its flags down to those that it calls, unless they set their own.
compiled = part(forceinline=False)
inlined = part(forceinline=True)
vectorised = part(forceinline=True, fastmath=FAST)


def _with_room(function: Callable[..., Any], args: tuple[Any, ...]) -> Any:
    return function(*args)


# Where a 16 KB chunk for Python's frames ends within the compiler, the next is made and freed at
# millions of calls: up to two seconds.  A frame that claims 320 KB has room for all in one.
_with_room.__code__ = _with_room.__code__.replace(co_stacksize=40_000)


def unhindered(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, run with room for its calls and without garbage collection.

    Looking through the millions of objects that compiling makes takes a tenth of the time.
    """

    @wraps(function)
    def run(*args: Any) -> Any:
        collecting = gc.isenabled()
        gc.disable()
        try:
            return _with_room(function, args)
        finally:
            if collecting:
                gc.enable()

    return run


_MODULES = sorted(Path(__file__).parent.glob("*.py"))
_STAMP = hashlib.sha256(b"".join(path.read_bytes() for path in _MODULES)).hexdigest()


class _KernelCache(FunctionCache):  # type: ignore[misc]
    """Numba's cache on disk, out of date as soon as any module of the kernel changes.

    Numba itself looks at the file of the function only, not at those of the functions it calls.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file._source_stamp = _STAMP

    def load_overload(self, *which: Any) -> Any:
        """Load a stored function, without what only compiling needs; None if it cannot be read."""
        try:
            return self._load_overload(*which)
        except OSError:
            return None
        except Exception:  # unpickling a damaged file can raise anything
            self.flush()
            return None

    def save_overload(self, *compiled: Any) -> None:
        """Keep what was compiled; if that fails, the process still has it in memory."""
        try:
            super().save_overload(*compiled)
        except OSError:
            _warn_that_nothing_is_kept()


@cache
def _warn_that_nothing_is_kept() -> None:
    """Warn once, in one line: a warning without a place in a file shows no source code."""
    warnings.warn_explicit(
        "there is no writable folder to keep compiled code in, so every start compiles again, for "
        "some ten seconds; set NUMBA_CACHE_DIR to a writable folder",
        RuntimeWarning,
        filename="d2d",
        lineno=0,
    )


def read_only(array: NDArray[Any], *shape: int) -> NDArray[Any]:
    """The array in this shape, contiguous and read-only.

    An entry is compiled anew for each type of its arguments; so all arrays become of one.
    """
    shaped = np.ascontiguousarray(array).reshape(shape)
    shaped.setflags(write=False)
    return shaped


def entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls."""
    options = {"error_model": "numpy", "_nrt": False, "no_cfunc_wrapper": True}
    dispatcher = njit(nogil=True, pipeline_class=_KernelCompiler, **options)(function)
    if config.DISABLE_JIT:
        return dispatcher
    try:
        dispatcher._cache = _KernelCache(function)
    except RuntimeError:  # Numba found no writable folder, beside this file or in the user's home
        _warn_that_nothing_is_kept()
    dispatcher.compile = unhindered(dispatcher.compile)
    return dispatcher
