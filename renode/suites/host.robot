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

An Emulation Ends In The Middle Of A Step
    FOR    ${n}    IN RANGE    6
        Power Up Board
        Begin Step    2000
        Reset Emulation
    END
    Power Up Board
    Begin Step    200
    Execute Command    server Disconnect
    # The step came to its end, and the board goes on.
    Advance    300
    ${now}=    Now Ms
    Should Be True    499 < ${now} < 501
    Connect
