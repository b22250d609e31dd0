include(CheckCXXSourceRuns)

# Sets `result` to the instruction sets that LAJOLLA_ISA asks for, the lowest first: what -march takes, or "default" for
# the compiler's own choice.
function(lajolla_instruction_sets result)
    set(found "${LAJOLLA_ISA}")
    if(found STREQUAL "all" AND NOT CMAKE_SYSTEM_NAME STREQUAL "Linux") # where processor.py cannot choose
        set(found native)
    endif()
    if(found MATCHES "^(all|native)$" AND NOT CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
        set(found "")
    endif()
    if(found STREQUAL "")
        set(found default)
    elseif(found STREQUAL "all")
        set(found x86-64-v2 x86-64-v3 x86-64-v4) # as src/lajolla/processor.py has them
    elseif(found STREQUAL "native")
        lajolla_native_isa(found)
    endif()
    set(${result} "${found}" PARENT_SCOPE)
endfunction()

# Sets `result` to the newest x86-64 level that the building machine runs and that is worth naming (v3 brings AVX2
# and FMA, v4 AVX-512).
function(lajolla_native_isa result)
    lajolla_runs(x86-64-v4 "avx512f avx512bw avx512cd avx512dq avx512vl" LAJOLLA_RUNS_X86_64_V4)
    lajolla_runs(x86-64-v3 "avx2 fma bmi bmi2" LAJOLLA_RUNS_X86_64_V3)
    if(LAJOLLA_RUNS_X86_64_V4)
        set(${result} x86-64-v4 PARENT_SCOPE)
    elseif(LAJOLLA_RUNS_X86_64_V3)
        set(${result} x86-64-v3 PARENT_SCOPE)
    else()
        set(${result} x86-64-v2 PARENT_SCOPE)
    endif()
endfunction()

# Whether this machine has all features of a level.
function(lajolla_runs level features variable)
    string(REPLACE " " ";" features "${features}")
    set(condition "true")
    foreach(feature IN LISTS features)
        string(APPEND condition " && __builtin_cpu_supports(\"${feature}\")")
    endforeach()
    check_cxx_source_runs("int main() { __builtin_cpu_init(); return ${condition} ? 0 : 1; }" ${variable})
    set(${variable} "${${variable}}" PARENT_SCOPE)
endfunction()
