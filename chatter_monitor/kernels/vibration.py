"""What is known of one vibration of a channel from one interval to the next."""

import numpy as np

# As the line of one that is not heard in an interval.
NO_LINE = -1
# Below such a rise (natural logarithm of the amplitude) it is as faint as ever; from so much on it is steady for
# certain (probability).
AS_EVER, SURELY_STEADY = 0.3, 0.9

VIBRATION = np.dtype(
    [
        ("frequency_hz", float),  # where it was heard last
        ("noise", float),  # probability of each of the `Kinds`
        ("growing", float),
        ("saturated", float),
        ("steady", float),
        ("unexplained", float),  # probability that nothing that turns explains it, if it has risen
        ("alarm_for", np.int64),  # intervals since an alarm began that is about it; 0 without one
        ("chattered", np.bool_),  # whether there has been one within the last minute
        ("line", np.int64),  # its line in this interval
        ("order_odds", float),  # log odds by its place among the orders, averaged
        ("dominance", float),  # its share of the power over some intervals; the largest in an alarm, off the orders
        ("power", float),  # mean of those intervals
        ("rise", float),  # by how much it is louder than it has been, averaged (natural logarithm)
        ("height", float),  # the largest that has been since it was as faint as ever (no average)
        ("step", float),  # by how much that has become larger with this interval
        ("leap", float),  # and with the two intervals, one after the other, that most of it came with
        ("told", float),  # log likelihood of its rise, as far as it has been counted
        ("level", float),  # by how much it was louder than it had been, when it was heard last (natural logarithm)
        ("missed", np.int64),  # intervals since its line was heard
        ("over", np.int64),  # intervals since an alarm about it
        ("own", np.int64),  # intervals since one that began without the memory of another
        ("chattered_hz", float),  # where it was heard in an alarm about it last, before it died down
        ("recalled", np.bool_),  # whether the alarm about it began by that memory
        ("mean", float),  # its power in an alarm, averaged, and the logarithm of that (`kernels.swings`)
        ("logarithm", float),
        ("settled", float),  # how far these averages have, since it was highest: 0 to 1
        ("dispersion", float),  # by how much the logarithm of the mean is the larger, averaged over such alarms
        ("listened", float),  # over so many intervals, as far as the averages had settled
        ("crest", float),  # largest logarithm of its amplitude in that alarm
        ("heard", np.int64),  # intervals in which it was
        ("late", np.bool_),  # whether it was noise yet when it had been heard in `ARRIVED` of them
        ("on_order", float),  # logarithm of its frequency when it was on an order last, NaN before
        ("place", float),  # logarithm of its frequency, filtered
        ("glide", float),  # by how much that changes in an interval
        ("jitter", float),  # mean square by which the filter misses
        ("gliding", np.int64),  # intervals in a row in which it has glided
        ("stood_hz", float),  # where it was steady last, averaged; 0 before
        ("family", float),  # how often it was one of a family of steady lines until it rose, averaged
        ("calm", float),  # its power before it rose to the last alarm about it; 0 where that is not known
        ("along", float),  # how often it was in step with something that has glided, averaged
        ("carried", float),  # how often it was a multiple of a line with less of the power until it rose, averaged
        ("glided", np.int64),  # intervals for which that counts yet
    ],
    align=True,
)
