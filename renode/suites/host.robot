*** Settings ***
Documentation     The host's real controller over the UART: forcectl moves this very emulation in lock-step.
Library           ForceBoard.py

*** Test Cases ***
Set Force With The Real Controller
    Power Up Board
    ${figures}=    Run Forcectl    set-force    0    2.5    0    --duration    2
    Should Be Equal As Integers    ${figures}[samples_lost]    0
    Should Be Equal As Integers    ${figures}[link_counters][frames_bad]    0
    Should Be Empty    ${figures}[faults]
    Should Be Equal As Numbers    ${figures}[amplifiers_off_s]    0
    Should Be True    ${figures}[metrics][tip_force_rms_n] < 0.2
    Should Be True    abs(${figures}[metrics][applied_n][1] - 2.5) < 0.1
    Output Should Be Zero
