// Carries the precompiled test headers; see tests/CMakeLists.txt.
