"""Structures of a law that is driven along motions: what is asked for, what a lane is at, what a block needs."""

from fraexp.kernels.structs import struct_dtype


class DrivenMotion:
    """A motion, counted in samples."""

    first_sample: int
    """First sample of its lead-in in the displacement."""
    lead_in: int
    """Samples of the lead-in from rest."""
    size: int
    """Samples of the motion itself."""
    max_passes: int
    """Passes through the motion: one, or as many as it takes until the force is periodic, up to this number."""
    lead_in_step: float
    """Time step of the lead-in [s]."""
    time_step: float
    """Time step of the motion [s]."""


class DrivenLane:
    """What a lane is at."""

    motion: int
    """Index of its motion."""
    stage: int
    """LEAD_IN, PASS or IDLE."""
    sample: int
    """Sample that comes next."""
    remaining: int
    """Samples left of the stage."""
    passes: int
    """Passes that are done."""


class DrivenFrame:
    """What a block of samples needs: sizes and addresses."""

    states: int
    """Number of states of the law."""
    samples: int
    """Samples to run."""
    current_memory: int
    """Which of the two halves of the law's memory holds its present state: 0 or 1."""
    next_motion: int
    """Index of the motion that is begun next."""
    arguments: int
    """Address: numbers of the law's arguments."""
    argument_sizes: int
    """Address: size of each argument."""
    memory: int
    """Address: state of the law, twice, with a guard between: the present one and the next one."""
    motion: int
    """Address: what is known of a sample, MOTION_ROWS."""
    displacement: int
    """Address: displacement of all motions [m]."""
    force: int
    """Address: force along all motions [N]."""
    cursors: int
    """Address: for each lane, the sample at which it reads its displacement and writes its force."""
    last_call: int
    """Address: the last call of a law that is observed, CALL_NUMBERS."""


MOTION_DTYPE, LANE_DTYPE, FRAME_DTYPE = struct_dtype(DrivenMotion), struct_dtype(DrivenLane), struct_dtype(DrivenFrame)
