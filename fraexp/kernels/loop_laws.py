"""The laws of a loop: that of friction, and that of its compensation; and the call of them that was recorded last."""

from typing import NamedTuple

from fraexp.kernels.batch_arrays import KernelBatch
from fraexp.kernels.call_watch import FIRST_BUILT_IN_STEPS
from fraexp.kernels.guards import state_half
from fraexp.kernels.law import Law, is_all_built_in
from fraexp.kernels.law_arguments import ArgumentKinds
from fraexp.kernels.law_error import LawCall
from fraexp.kernels.observed_law import FRICTION


class Laws(NamedTuple):
    """The law of friction and that of its compensation, if any, with the kinds of their arguments."""

    law: Law
    kinds: ArgumentKinds
    compensation_law: Law | None = None
    compensation_kinds: ArgumentKinds = ()
    is_set_valued: tuple[bool, ...] = (False,)
    """Whether friction at each contact is a law of velocity that jumps at rest. For several contacts, the law takes the
    number of one before its other arguments."""

    @property
    def given(self) -> tuple[Law, ...]:
        """The law, and that of the compensation, if any."""
        return (self.law,) if self.compensation_law is None else (self.law, self.compensation_law)

    @property
    def first_steps(self) -> int:
        """Steps of the first call into compiled code: few, if a law might be slow."""
        return FIRST_BUILT_IN_STEPS if all(map(is_all_built_in, self.given)) else 0

    def is_observed(self, is_vectorised: bool) -> bool:
        """Whether calls of the laws are recorded: those of dropped-in laws in the scalar kernel, at one contact."""
        if len(self.is_set_valued) > 1:
            return False
        return not (is_vectorised or all(map(is_all_built_in, self.given)))


def last_call(laws: Laws, batch: KernelBatch) -> tuple[Law, LawCall | None]:
    """Return the law that was called last, and the call, if it is on record."""
    if not laws.is_observed(batch.layout.is_vectorised):
        return laws.law, None
    number, half, dy, dt = batch.last_call.tolist()
    z = state_half(batch.law_memories[int(number)], int(half) if number == FRICTION else 0)[:, 0]
    return laws.given[int(number)], LawCall(z.copy(), dy, dt)
