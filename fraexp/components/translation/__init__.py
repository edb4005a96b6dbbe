"""Translation of pure functions, such as friction laws, from Python to C99 and IEC 61131-3 Structured Text."""
