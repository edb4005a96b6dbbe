"""Files of samples that grow: what was written is readable at any moment."""

from pathlib import Path

import numpy as np
import pytest

from fraexp.data.sample_file import SampleHeader, SampleWriter, create_sample_file, read_header, read_samples
from fraexp.errors import RecordError
from tests.refusals import refused

HEADER = SampleHeader(1e-3, {"play": "", "y": "µm", "u": "N"})


def test_rows_that_were_cut_off_are_neither_read_nor_kept(tmp_path: Path) -> None:
    path, rows = tmp_path / "a.samples", np.arange(30.0).reshape(10, 3)
    create_sample_file(path, HEADER)
    writer = SampleWriter(path)
    writer.append(rows)
    writer.close()
    whole = path.read_bytes()
    header, length = read_header(path)
    assert header == HEADER
    plain = np.fromfile(path, "<f8", offset=len(whole.split(b"\n")[0]) + 1).reshape(-1, 3)  # with NumPy alone
    np.testing.assert_array_equal(plain, rows)
    for cut in (1, 8, 23):
        path.write_bytes(whole[:-cut])
        np.testing.assert_array_equal(read_samples(path, [2, 0], header, length), rows[:-1, [2, 0]].T)
        again = SampleWriter(path)
        assert (again.rows, again.last_play()) == (9, 24)
        again.append(rows[-1:])
        again.close()
        assert path.read_bytes() == whole


@pytest.mark.parametrize("content", [b"", b"time,y\n1,2\n", b'{"format": "other"}\n', b"\xff\xfe\n", b"[1]\n"])
def test_another_kind_of_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.samples"
    path.write_bytes(content)
    with refused(RecordError, "a.samples"):
        read_header(path)
