*** Settings ***
Documentation     Each fault that can be made from outside ends at 0 V, with its number.
Library           ForceBoard.py

*** Test Cases ***
Sensor Unplugged While Running
    Armed Board
    Output Should Drive
    Execute Command    cell3 Unplugged true
    Hold For    200
    Unit Fault Should Be    3    sensor silent
    Output Should Be Zero    3
    Output Should Drive    1    2    4    5    6
    Board State Should Be    running

Sensor Answers With NACK
    Armed Board
    Execute Command    cell2 Nacks true
    Hold For    300
    Unit Fault Should Be    2    sensor reads
    Output Should Be Zero    2
    Output Should Drive    1    3    4    5    6

Sensor Comes Back After Clear
    Armed Board
    Execute Command    cell5 Unplugged true
    Hold For    200
    Unit Fault Should Be    5    sensor silent
    Execute Command    cell5 Unplugged false
    Disarm
    Advance    300
    Request    ClearFaults
    Advance    3000
    All Units Should Be    ready

Sensor Missing At Bring-Up
    Power Up Board
    Advance    300
    Execute Command    cell4 Unplugged true
    Connect
    Run Keyword And Expect Error    *six units ready*    Bring Up Units    within_ms=3000
    Unit Fault Should Be    4    bring-up failed
    Output Should Be Zero

Stuck Bus Is Freed
    Armed Board
    ${before}=    Status
    Execute Command    mux HoldSda
    Hold For    500
    ${after}=    Status
    Should Be True    ${after}[bus_recoveries] > ${before}[bus_recoveries]
    Board State Should Be    running
    Output Should Drive

Bus Shorted For Good
    Armed Board
    Execute Command    mux HoldSda true
    Hold For    600
    Output Should Be Zero
    Board Fault Should Be    I2C bus stuck

Multiplexer Without Supply
    Armed Board
    Execute Command    mux Silent true
    Hold For    600
    Output Should Be Zero
    ${status}=    Status
    # Either the multiplexer is named, or each unit whose reads fail.
    Should Be True    $status['fault'] == 7 or all(u['fault'] == 41 for u in $status['units'])

Host Falls Silent
    Armed Board
    Output Should Drive
    Advance    90
    Output Should Drive
    Advance    60
    Output Should Be Zero
    Board Fault Should Be    setpoints expired

Stop Command
    Armed Board
    LED Should Be    Green    on
    LED Should Be    Red    off
    Request    Stop
    Advance    5
    Output Should Be Zero
    Board Fault Should Be    host stop
    LED Should Be    Green    off
    LED Should Be    Red    on
    ${reply}=    Ask    Arm
    Should Be Equal    ${reply}[response]    Rejected
    Should Be Equal    ${reply}[error]    Faulted

E-Stop Pressed While Running
    Armed Board
    Execute Command    plc Press true
    Advance    5
    Output Should Be Zero
    ${power}=    Execute Command    rig AmplifierOn
    Should Contain    ${power}    False
    Board Fault Should Be    E-stop
    ${reply}=    Ask    ClearFaults
    Should Be Equal    ${reply}[error]    Faulted
    Board Fault Should Be    E-stop
    Execute Command    plc Press false
    Advance    20
    Request    ClearFaults
    Advance    20
    Board State Should Be    ready

Over-Tension
    # Below the 20 N that the board guards at the tip, with the other cables' 4 N added.
    Armed Board    over_tension_un=12000000
    Execute Command    rig PullCable 6 14
    # Shorter than the 75 ms in which a cable must let go: this one is pulled on.
    Hold For    50
    Unit Fault Should Be    6    over-tension
    Output Should Be Zero    6
    Output Should Drive    1    2    3    4    5

Spike Is No Force
    Armed Board
    ${before}=    Status
    Execute Command    cell1 Spike 500000
    Hold For    100
    ${after}=    Status
    Should Be True    ${after}[units][0][spikes] == ${before}[units][0][spikes] + 1
    Board State Should Be    running
    Tensions Should Be    4    0.6

Watchdog Resets A Hung Loop And Leaves A Crash Record
    Armed Board
    Output Should Drive
    Execute Command    rig HangLoop
    Advance    1500
    ${resets}=    Number    rig Resets
    Should Be Equal As Integers    ${resets}    1
    Output Should Be Zero
    ${hello}=    Connect
    # IWDG1RSTF
    Should Be True    ${hello}[reset_flags] & (1 << 26)
    Crash Record Should Be    watchdog reset
    Output Should Be Zero
