include(CheckCXXSourceRuns)

# Sets `result` to the newest x86-64 level that the building machine runs and that is worth naming (v3 brings AVX2
# and FMA), or to nothing where -march is better left alone.
function(lajolla_native_isa result)
    if(NOT CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
        set(${result} "" PARENT_SCOPE)
        return()
    endif()
    check_cxx_source_runs("
        int main() {
            __builtin_cpu_init();
            const bool v3 = __builtin_cpu_supports(\"avx2\") && __builtin_cpu_supports(\"fma\") &&
                            __builtin_cpu_supports(\"bmi\") && __builtin_cpu_supports(\"bmi2\");
            return v3 ? 0 : 1;
        }" LAJOLLA_RUNS_X86_64_V3)
    if(LAJOLLA_RUNS_X86_64_V3)
        set(${result} x86-64-v3 PARENT_SCOPE)
    else()
        set(${result} x86-64-v2 PARENT_SCOPE)
    endif()
endfunction()
