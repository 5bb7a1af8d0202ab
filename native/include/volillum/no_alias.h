// Loops over rows that are read and rows that are written.
#pragma once

// Rows that are read never overlap those that are written; with so many pointers the compiler gives
// up on finding that out at run time.
#if defined(__clang__)
#define VOLILLUM_NO_ALIAS _Pragma("clang loop vectorize(assume_safety)")
#elif defined(__GNUC__)
#define VOLILLUM_NO_ALIAS _Pragma("GCC ivdep")
#else
#define VOLILLUM_NO_ALIAS
#endif
