"""How the kernels of the tracker are compiled."""

from typing import Any

OPTIONS: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    # NaN survives these; "reassoc" is left out because vectorised loops over seven numbers are slower than plain ones.
    "fastmath": {"contract", "nsz"},
    # No reference counting: kernels only borrow arrays, and the compiler then refuses any that would allocate. Without
    # it atomic counters take more than half of the time (docs/decisions/0002-kernels-without-reference-counts.md).
    "_nrt": False,
}
# Of kernels in lanes: a product and a sum are joined where the source says so, not where the compiler likes, which
# might differ with the number of lanes.
EXACT: dict[str, Any] = {**OPTIONS, "fastmath": {"nsz"}}
# Of kernels that add up many numbers, in whatever order is soonest done.
SUMS: dict[str, Any] = {**OPTIONS, "fastmath": OPTIONS["fastmath"] | {"reassoc"}}
# Of kernels that become part of each kernel that calls them. Else the compiler keeps a copy with each of those and
# optimises it in its own way; a process calls the copy that it happened to load first, and the last bits of a result
# would depend on what was compiled just now and what was read from the cache.
WITHIN: dict[str, Any] = {**OPTIONS, "forceinline": True}
